"""The network that predicts a fish's motion (fish paper §3.1, §5.1.1; Eqs. 1–4, Figs. 6, 15).

From motion area, swimming type, displacement and included angle it predicts motion area and
swimming type Δ later.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "held_out": ["assess_model"],
    "model": ["MotionModel", "pair_rows_with_later", "restore_motion_model", "split_by_blocks",
              "split_by_tracks"],
    "onnx": ["export_onnx_bytes"], "back_propagation": ["train_motion_model"],
})  # fmt: skip
