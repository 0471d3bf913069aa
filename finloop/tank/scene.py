"""The tank as a scene of VTK, drawn off-screen in software: floor, glass, water and fish.

It is quick without a graphics card: one window for all pictures, one light, no oversampling. Water
is computed at the corners of its mesh, light and shadow on a picture of the floor, so that only
fish are lit pixel by pixel.
"""

import ctypes
import os
import sys
from collections.abc import Sequence
from contextlib import AbstractContextManager
from itertools import chain
from typing import Any, cast

import cv2
import numpy as np
import pyvista as pv
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkCommonCore import vtkUnsignedCharArray

from finloop.base.arrays import Picture
from finloop.base.errors import FinloopError
from finloop.render.living import LivingTank
from finloop.tank.body import AROUND as AROUND_BODY
from finloop.tank.body import RINGS, surface_triangles, texture_coordinates
from finloop.tank.camera import GLASS_PER_DEPTH, VIEW_DEG, CameraViews, TankSize
from finloop.tank.light import SUN, WATER, LitFloor, WaterSurface
from finloop.tank.skin import AROUND, LENGTHWISE, SurfaceAndSkin

_SKY = {-1.0: "#06161d", -0.25: "#0d2a35", 0.0: "#41707f", 0.3: "#7fadb9", 1.0: "#a9cdd5"}
_SKY_PX = 6.0  # film widths to the sky; by the sine of the elevation, its colours
_GLASS, _EDGE = "#d5f0f5", "#e6fbff"
_GLASS_ALPHA, _EDGE_ALPHA = 0.07, 0.75
_COLOURS = "colours"  # name of VTK's array
_LIBRARIES = {  # by name: the window of VTK that needs it
    "libEGL.so.1": "vtkEGLRenderWindow",
    "libOSMesa.so.8": "vtkOSOpenGLRenderWindow",
    "libOSMesa.so": "vtkOSOpenGLRenderWindow",
}


def select_offscreen_renderer(libraries: dict[str, str] = _LIBRARIES) -> None:
    """Make VTK draw off-screen, with the first of some libraries that is installed.

    libraries: VTK's window by the library that it needs. Call it before the first window. On
    systems other than Linux VTK brings what it needs. FinloopError if none is installed.
    """
    if not sys.platform.startswith("linux"):
        return
    for library, window in libraries.items():
        try:
            ctypes.CDLL(library)
        except OSError:
            continue
        os.environ["VTK_DEFAULT_OPENGL_WINDOW"] = window  # else it asks for a screen first
        return
    raise FinloopError(
        f"none of {', '.join(libraries)} is installed, so that nothing can be drawn in 3-D",
        "a library that draws without a screen",
        "install one (Debian, Ubuntu: apt-get install libegl1), then: dvc repro tank",
    )


class TankScene(AbstractContextManager["TankScene"]):
    """An off-screen window in which the tank is drawn; `close` it, or use a `with` block.

    Call `select_offscreen_renderer` before.
    """

    def __init__(
        self, background: Picture, tank: TankSize, size: tuple[int, int], fish: int = 1,
        living: LivingTank | None = None,
    ) -> None:  # fmt: skip
        """Open the window and add light, sky, floor, fish (how many), water and glass.

        background: (H, W) or (H, W, 3) uint8, the floor; size: width and height of pictures, px;
        living: how the floor changes from tick to tick, None = not at all.
        """
        self._size, self._tank = size, tank
        self._plotter = pv.Plotter(off_screen=True, window_size=list(size), lighting="none")
        self._window = cast(Any, self._plotter.ren_win)
        self._window.SetMultiSamples(1)
        self._plotter.renderer.SetUseOIT(False)  # layers are drawn in order: no need to sort
        self._plotter.camera.view_angle = VIEW_DEG
        self._floor, self._water = LitFloor(background, tank, living), WaterSurface(tank)
        self._add_light()
        self._add_sky()
        self._floor_picture = self._add_floor()
        self._fish = [self._add_fish() for _ in range(fish)]
        self._surface = self._add_water()
        self._add_glass()
        self._pixels = vtkUnsignedCharArray()
        self._plotter.show(auto_close=False)

    def __exit__(self, *error: object) -> None:
        """Close the window."""
        self.close()

    def close(self) -> None:
        """Close the window."""
        self._plotter.close()

    def draw_frame(
        self, fish: Sequence[SurfaceAndSkin], views: CameraViews, tick: int, time_s: float
    ) -> Picture:
        """Draw the tank with all its fish at a tick; return the picture (height, width, 3) uint8.

        views: the camera at every tick; time_s: of the waves and the light.
        """
        self._aim_camera(views, tick)
        for (points, normals, skin), (mesh, picture) in zip(fish, self._fish, strict=True):
            mesh.points[:] = points.reshape(-1, 3)
            mesh.point_data["Normals"][:] = normals.reshape(-1, 3)
            picture.point_data[_COLOURS][:] = skin[::-1].reshape(-1, 3)  # VTK begins below
        all_points = [points for points, _, _ in fish]
        floor = cv2.flip(self._floor.draw_floor(all_points, time_s, tick), 0)
        floor_pixels = self._floor_picture.point_data[_COLOURS]
        floor_pixels[:] = floor.reshape(floor_pixels.shape)
        water_points, colours = self._water.points_and_colours(
            time_s, views.place[tick], parallel=views.half_height_px is not None
        )
        self._surface.points[:] = water_points
        self._surface.point_data[_COLOURS][:] = colours
        for item in (*chain(*self._fish), self._floor_picture, self._surface):
            item.Modified()  # tells VTK to draw it anew
        self._window.Render()
        width, height = self._size
        self._window.GetPixelData(0, 0, width - 1, height - 1, 0, self._pixels, 0)
        return cv2.flip(vtk_to_numpy(self._pixels).reshape(height, width, 3), 0)

    def _aim_camera(self, views: CameraViews, tick: int) -> None:
        """Place and aim VTK's camera for a tick; views: the camera at every tick.

        A parallel view is from above. VTK's parallel scale is half its height.
        """
        camera = self._plotter.camera
        camera.position, camera.focal_point = views.place[tick], views.aim[tick]
        camera.up = (0, 0, 1) if views.half_height_px is None else (0, 1, 0)
        camera.SetParallelProjection(views.half_height_px is not None)
        if views.half_height_px is not None:
            camera.SetParallelScale(views.half_height_px)
        # Distances of the nearest and the farthest that is drawn: beyond the sky.
        camera.clipping_range = 0.2 * self._tank.body_length, 25 * self._tank.width

    def _add_light(self) -> None:
        """Add the sun and a weak light from below; numbers are chosen for the looks."""
        for place, intensity in ((tuple(SUN), 0.95), ((0.3, -0.6, -0.5), 0.38)):
            light = pv.Light(position=place, light_type="scene light", intensity=intensity)
            light.positional = False
            self._plotter.add_light(light)

    def _add_sky(self) -> None:
        """Add the sky, a ball around everything; VTK's own gradient takes twice as long."""
        ball = pv.Sphere(
            radius=_SKY_PX * self._tank.width, center=self._tank.middle.tolist(),
            theta_resolution=24, phi_resolution=33,
        )  # fmt: skip
        elevation_sine = (ball.points[:, 2] - self._tank.middle[2]) / (_SKY_PX * self._tank.width)
        colours = np.array([pv.Color(colour).int_rgb for colour in _SKY.values()], float)
        levels = [np.interp(elevation_sine, list(_SKY), channel) for channel in colours.T]
        ball[_COLOURS] = np.rint(np.stack(levels, -1)).astype(np.uint8)
        self._plotter.add_mesh(ball, scalars=_COLOURS, rgba=True, lighting=False)

    def _add_floor(self) -> Any:
        """Add the floor; return its VTK image, to replace at every tick."""
        picture = _empty_image(self._floor.plain.shape)
        corners = np.c_[self._tank.corners, np.zeros(4)]
        mesh = pv.PolyData(corners, np.array([4, 0, 1, 2, 3]))
        mesh.active_texture_coordinates = np.array([[0, 0], [1, 0], [1, 1], [0, 1]], float)
        self._plotter.add_mesh(mesh, texture=_smooth_texture(picture), lighting=False, color=WATER)
        return picture

    def _add_fish(self) -> tuple[Any, Any]:
        """Add a fish; return its mesh and the VTK image of its skin, to change at every tick."""
        skin = _empty_image((AROUND, LENGTHWISE, 3))
        faces = np.insert(surface_triangles(), 0, 3, axis=1).ravel()
        mesh = pv.PolyData(np.zeros((RINGS * AROUND_BODY, 3)), faces)
        # VTK counts a texture's rows from below.
        mesh.active_texture_coordinates = texture_coordinates() * (1, -1) + (0, 1)
        # Points and normals are set at every tick.
        mesh.point_data.active_normals = np.tile([0.0, 0.0, 1.0], (RINGS * AROUND_BODY, 1))
        self._plotter.add_mesh(
            mesh, texture=_smooth_texture(skin), ambient=0.34, diffuse=0.8, specular=0.32,
            specular_power=28, smooth_shading=False, interpolation="Phong",
        )  # fmt: skip
        return mesh, skin

    def _add_water(self) -> Any:
        """Add the surface of the water; return its mesh, to change at every tick."""
        rows, columns = self._water.x.shape
        first = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).ravel()
        # Each face of the mesh, as VTK has it: 4, then the numbers of its four corners.
        faces = np.stack(
            [np.full_like(first, 4), first, first + 1, first + columns + 1, first + columns], -1
        )
        points, colours = self._water.points_and_colours(0.0, self._tank.middle, parallel=True)
        mesh = pv.PolyData(points, faces.ravel())
        mesh[_COLOURS] = colours
        self._plotter.add_mesh(mesh, scalars=_COLOURS, rgba=True, lighting=False)
        return mesh

    def _add_glass(self) -> None:
        """Add the glass walls and their bright edges."""
        tank = self._tank
        (left, bottom), (right, top) = tank.corners[[0, 2]]
        box = pv.Box((left, right, bottom, top, 0, GLASS_PER_DEPTH * tank.depth))
        upright = [i for i in range(6) if np.ptp(box.get_cell(i).points[:, 2]) > 0]  # 4 of 6 sides
        walls = box.extract_cells(upright)
        self._plotter.add_mesh(walls, color=_GLASS, opacity=_GLASS_ALPHA, lighting=False)
        edges = box.extract_all_edges()
        self._plotter.add_mesh(
            edges.tube(radius=0.0016 * tank.width, n_sides=6), color=_EDGE, opacity=_EDGE_ALPHA,
            lighting=False,
        )  # fmt: skip


def _empty_image(shape: tuple[int, ...]) -> Any:
    """Return a black VTK image of a shape (height, width …), whose pixels can be replaced."""
    height, width = shape[:2]
    image = pv.ImageData(dimensions=(width, height, 1))
    image.point_data[_COLOURS] = np.zeros((width * height, *shape[2:]), np.uint8)
    image.set_active_scalars(_COLOURS)
    return image


def _smooth_texture(image: Any) -> pv.Texture:
    """Return a texture that shows a VTK image, smoothly interpolated."""
    texture = pv.Texture(image)
    texture.interpolate = True
    return texture
