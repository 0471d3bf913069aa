"""Settings whose constants have other values, for what a film shows them at."""

from dataclasses import fields, replace
from typing import Any


def with_constants(settings: Any, **values: Any) -> Any:
    """Return the settings with other values of parameters, and of constants of their class."""
    parameters = {one.name for one in fields(settings)} & values.keys()
    constants = {name: value for name, value in values.items() if name not in parameters}
    assert all(hasattr(settings, name) for name in constants), constants
    changed = replace(settings, **{name: values[name] for name in parameters})
    return type(type(settings).__name__, (type(settings),), constants)(**vars(changed))
