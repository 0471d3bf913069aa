"""Typed config groups for Hydra, which finds them by `hydra_plugins/finloop_schemas.py`.

While `dvc exp run` or `make params` composes conf/, this registers

- a schema `schema/<word>/<option>` per parameter dataclass, which conf/<word>/<option>.yaml names
  in its defaults list;
- the schema `hydra/sweeper/finloop` of the sweeps in conf/experiment/;
- the resolver `${conf_sha256:}`, which stamps the result with a digest of conf/. It sees the whole
  composed config before anything is written, and refuses unknown keys and wrong values (each with
  what to type), missing groups, and what cannot work together (`stages.conflicts`);
- the resolvers `${film_stamp:}`, `${tracks_stamp:}`, `${path_stamp:}` and `${retarget_stamp:}`, of
  the files that the parameters name.
"""

from collections.abc import Callable, Iterable
from dataclasses import fields, make_dataclass
from functools import partial
from pathlib import Path
from types import UnionType
from typing import Any, Literal, Union, get_args, get_origin, get_type_hints

from dvc.exceptions import DvcException
from hydra.core.config_store import ConfigStore
from omegaconf import DictConfig, OmegaConf
from omegaconf.errors import InterpolationResolutionError

from finloop.base.errors import FinloopError
from finloop.base.settings import CONF as SHIPPED
from finloop.base.settings import GROUPS, variants
from finloop.io.parameters import refusal_error
from stages.conflicts import find_conflicts
from stages.experiment import Experiment
from stages.settings import CONF, FILES, STAMP, STAMPS, conf_stamp, list_problems
from stages.stamps import file_stamp


class CompositionError(FinloopError, InterpolationResolutionError, DvcException):
    """An error whose text reaches the user unchanged through OmegaConf and `dvc exp run`.

    Each of the two prints the text of its own errors, and words of its own around any other.
    """


def omegaconf_schema(option: type) -> type:
    """Return a settings dataclass as one for OmegaConf: not frozen, without ranges and defaults.

    A parameter that may be a number gets the type `Any`: `finloop.base.settings` checks it, takes
    whole numbers for numbers, too, and its message says what to type.
    """
    hints = get_type_hints(option)  # drops Annotated
    types = [(field.name, _simplify_type(hints[field.name])) for field in fields(option)]
    return make_dataclass(option.__name__, types)


def _simplify_type(hint: Any) -> Any:
    """Return an annotation that OmegaConf understands: `Any` for numbers and for unions with lists.

    A Literal becomes the type of its values, a tuple of Literals a tuple of texts.
    """
    parts = get_args(hint)
    if get_origin(hint) is Literal:
        return type(parts[0])
    if not {int, float, bool}.isdisjoint(_leaf_types(hint)):
        return Any
    if get_origin(hint) in (Union, UnionType):
        return Any if any(map(get_origin, parts)) else hint
    if get_origin(hint) is tuple and get_origin(parts[0]) is Literal:
        return tuple[str, ...]
    return hint


def _leaf_types(hint: Any) -> set[Any]:
    """Return the plain types in an annotation: {int, NoneType} of int | None."""
    parts = () if get_origin(hint) is Literal else get_args(hint)
    return set().union(*map(_leaf_types, parts)) if parts else {hint}


def check_and_stamp(*, _root_: DictConfig) -> str:
    """Check all parameters of a composed config; return the stamp, a digest, of conf/.

    _root_: the whole composed config, which Hydra passes by this name. The error lists all
    parameters that are wrong or contradict others.
    """
    values = _plain_groups(_root_, {*map(str, _root_)} - {*STAMPS})
    if problems := list_problems(values) or find_conflicts(values):
        raise refusal_error(problems)
    return conf_stamp(_find_conf())


def _find_conf() -> Path:
    """Return the nearest folder conf/ at or above the present folder, else the shipped one."""
    folders = (folder / CONF for folder in (Path.cwd(), *Path.cwd().parents))
    return next((conf for conf in folders if (conf / "config.yaml").is_file()), SHIPPED)


def _stamp_files(name: str, *, _root_: DictConfig) -> str | None:
    """Return a digest of the files that a composed config names; None if one is missing.

    name: which files, one of `FILES`. _root_: the whole config, which Hydra passes by this name.
    """
    return file_stamp(name, _plain_groups(_root_, ("clip", "extract", "matching", "retarget")))


def _plain_groups(root: DictConfig, words: Iterable[str]) -> dict[str, Any]:
    """Return groups of a composed config as plain values, by name; {} for a missing one.

    words: names of the groups.
    """
    groups: dict[str, Any] = {}
    for word in words:  # one by one: to resolve the root would resolve the stamps again
        node: Any = root._get_node(word)
        is_config = OmegaConf.is_config(node)
        groups[word] = OmegaConf.to_container(node, resolve=True) if is_config else node or {}
    return groups


def _register_resolver(name: str, resolver: Callable[..., str | None]) -> None:
    """Register an OmegaConf resolver `${name:}` that gets the whole config."""

    def resolve(*, _root_: DictConfig) -> str | None:
        """Return the resolver's value; raise its FinloopError as a CompositionError."""
        try:
            return resolver(_root_=_root_)
        except FinloopError as error:
            # Without its cause, whose text DVC would print once more.
            raise CompositionError(error.came, error.wanted, error.do) from None

    OmegaConf.register_new_resolver(name, resolve, replace=True)


for word in GROUPS:
    for name, option in variants(word).items():
        node = OmegaConf.structured(omegaconf_schema(option), flags={"struct": False})
        ConfigStore.instance().store(group=f"schema/{word}", name=name, node=node)
sweeper = omegaconf_schema(Experiment)
ConfigStore.instance().store(group="hydra/sweeper", name="finloop", node=sweeper)
_register_resolver(STAMP, check_and_stamp)
for name in FILES:
    _register_resolver(name, partial(_stamp_files, name))
