"""Files, and nothing else: arrays, tables and schemas, but no method of the papers.

Every output appears under its name only when it is complete (`atomic`). Tables have schemas, which
are checked on save and on load.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "atomic": ["save_bytes", "whole_file", "whole_folder"],
    "cutouts": ["CutoutWriter", "open_cutouts"],
    "picture": ["load_picture", "save_figure", "save_picture"],
    "record": ["load_json", "load_record", "save_json", "save_record"], "svg": ["load_svg"],
    "table": ["load_table", "save_csv", "save_table"],
    "video": ["VideoFacts", "load_facts", "read_frames"],
})  # fmt: skip
