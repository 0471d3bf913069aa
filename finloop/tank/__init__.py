"""The tank in three dimensions (no section of the papers): the fish as a lofted body, water, light.

The body (`body`, `skin`), an edit list as bodies (`swim`, `fish`), floor and water (`light`), the
camera (`camera`), the drawing (`scene`), and the same as a glTF file (`gltf`).
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach(__name__, submod_attrs={
    "camera": ["CameraViews", "TankSize", "camera_views"], "fish": ["FishSurface"],
    "gltf": ["encode_tank_glb"],
    "scene": ["TankScene"], "swim": ["film_body_shapes", "poses_in_tank"],
})  # fmt: skip
