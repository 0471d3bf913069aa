"""Build one page of all results, and compare experiments (no section of the papers).

The page (`page`), its pictures (`figures`) and tables (`tables`), a comparison of runs (`compare`).
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "compare": ["compare_experiments", "pareto_front"], "page": ["render_template", "encode_webp"],
    "tables": ["Table", "measures_table"],
})  # fmt: skip
