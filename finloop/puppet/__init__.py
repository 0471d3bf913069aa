"""Draw any film row in any pose, mirrored or not, at any position, heading and size.

A pose has a backbone. Each pixel of the new picture takes the film's pixel at the same place along
and beside the backbone: a fish of the film can bend as in no frame, and two frames that are blended
in one pose differ in light and skin, not in shape.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "drawing": [
        "PosedPicture", "change_in_pose", "draw_in_pose", "mix_pictures", "pose_cutout",
        "second_shares",
    ],
    "pose": ["Pose", "poses_from_features"],
    "shapes": ["PoseShapes"], "strip": ["PlacedBackbone"],
    "tail": ["TailParameters", "align_body_and_tail", "visible_tail_spread"],
})  # fmt: skip
