"""Limits for YAML of strangers: how deep it is nested, and how many values its aliases make."""

import yaml

_MOST_VALUES, _DEEPEST = 100_000, 50


def refuse_yaml_bomb(text: str) -> None:
    """Raise YAMLError if a YAML text is nested too deeply, or its aliases make too many values.

    A few lines of aliases of aliases stand for billions of values, and deep nesting ends the
    process. The text is not built, only looked through.
    """
    sizes: dict[str, int] = {}  # of anchored values, by name
    open_values: list[tuple[str | None, int]] = []  # anchor, and count before it
    count = 0
    for event in yaml.parse(text, yaml.CSafeLoader):
        if isinstance(event, yaml.CollectionStartEvent):
            open_values.append((event.anchor, count))
            count += 1
        elif isinstance(event, yaml.CollectionEndEvent):
            anchor, before = open_values.pop()
            _keep_size(sizes, anchor, count - before)
        elif isinstance(event, yaml.ScalarEvent):
            count += 1
            _keep_size(sizes, event.anchor, 1)
        elif isinstance(event, yaml.AliasEvent):
            if event.anchor not in sizes:
                raise yaml.YAMLError(f"the alias *{event.anchor} stands for no value before it")
            count += sizes[event.anchor]
        if len(open_values) > _DEEPEST:
            raise yaml.YAMLError(f"it is nested more than {_DEEPEST} levels deep")
        if count > _MOST_VALUES:
            raise yaml.YAMLError(f"it has more than {_MOST_VALUES} values, aliases written out")


def _keep_size(sizes: dict[str, int], anchor: str | None, size: int) -> None:
    """Set the size of an anchored value; do nothing without an anchor."""
    if anchor is not None:
        sizes[anchor] = size
