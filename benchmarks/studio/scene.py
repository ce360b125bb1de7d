"""The scene in Blender: a set, people and a ball at a time, and how a camera sees them."""

from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
from captures import Capture
from figure import Performer, make_performer
from materials import glowing, plain
from mathutils import Matrix
from rig import BOX_MARGIN, Camera
from room import Room, make_room, make_screen

SETS: dict[str, Callable[[bpy.types.Scene], Room]] = {
    "room": make_room,
    "green": lambda scene: make_screen(scene, (0.03, 0.42, 0.06), whole=True),
    "green floor": lambda scene: make_screen(scene, (0.03, 0.42, 0.06), whole=False),
    "gray": lambda scene: make_screen(scene, (0.2, 0.2, 0.2), whole=True),
}
THROW = (np.array([-0.55, -0.75, 1.25]), np.array([0.62, 0.25, 2.45]))
"""Where the ball is at the start, and its velocity in meters per second."""


class Scene:
    """Renders pictures, mattes and depths of a capture."""

    def __init__(self, capture: Capture) -> None:
        bpy.ops.wm.read_factory_settings(use_empty=True)
        self.capture, self.scene = capture, bpy.context.scene
        self.room = SETS[capture.set](self.scene)
        self.people = bpy.data.collections.new("people")
        self.scene.collection.children.link(self.people)
        apart = 0.62 if len(capture.people) > 1 else 0.0
        self.performers: list[Performer] = []
        for number, colors in enumerate(capture.people):
            place = (apart * (2 * number - 1), 0.0, 0.012) if apart else (0.0, 0.0, 0.012)
            self.performers.append(make_performer(place, 0.35 * number, colors, 3 + number))
        for thing in [thing for performer in self.performers for thing in performer.objects]:
            self.people.objects.link(thing)
        self.ball = None
        if capture.ball:
            self.ball = self.room.ball((0, 0, 1), 0.11, plain("ball", (0.75, 0.28, 0.02), 0.45))
            self.room.collection.objects.unlink(self.ball)
            self.people.objects.link(self.ball)
        self.camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
        self.scene.collection.objects.link(self.camera)
        self.scene.camera = self.camera
        self._settings()

    def _settings(self) -> None:
        scene, cycles = self.scene, self.scene.cycles
        scene.render.engine = "CYCLES"
        cycles.use_denoising, cycles.denoising_quality, cycles.seed = True, "BALANCED", 0
        cycles.use_adaptive_sampling, cycles.adaptive_threshold = True, 0.02
        cycles.max_bounces, cycles.diffuse_bounces, cycles.glossy_bounces = 4, 3, 2
        cycles.transparent_max_bounces = 4
        cycles.caustics_reflective = cycles.caustics_refractive = False
        cycles.sample_clamp_indirect = 4.0
        scene.render.use_persistent_data = True
        scene.render.film_transparent = True  # the matte is the alpha of what is not held out
        scene.render.resolution_percentage = 100
        scene.view_settings.view_transform = "Raw"
        picture = scene.view_layers[0]
        picture.name, picture.use_pass_z = "picture", True
        matte = scene.view_layers.new("matte")
        matte.layer_collection.children["set"].holdout = True
        matte.material_override = glowing("matte", (1.0, 1.0, 1.0), 1.0)
        matte.material_override.cycles.emission_sampling = "NONE"  # else all faces become lights
        matte.samples, matte.cycles.use_denoising = 16, False
        scene.use_nodes = True
        tree = scene.node_tree
        tree.nodes.clear()
        self.output = tree.nodes.new("CompositorNodeOutputFile")
        self.output.format.file_format, self.output.format.color_depth = "OPEN_EXR", "32"
        self.output.file_slots.clear()
        for slot, layer, socket in (
            ("picture", "picture", "Image"),
            ("matte", "matte", "Alpha"),
            ("depth", "picture", "Depth"),
        ):
            self.output.file_slots.new(slot)
            source = tree.nodes.new("CompositorNodeRLayers")
            source.layer = layer
            tree.links.new(source.outputs[socket], self.output.inputs[slot])

    def skirts(self, times: np.ndarray) -> None:
        """Compute the skirts at all times that will be shown; the same numbers whichever frames are rendered later."""
        self.times = np.unique(np.round(times, 6))
        self.swung = [
            performer.skirt.simulate(performer.bones, self.times - performer.delay) for performer in self.performers
        ]

    def put(self, time: float) -> None:
        """Move people and ball to a time that `skirts` knows."""
        index = int(np.abs(self.times - time).argmin())
        for performer, swung in zip(self.performers, self.swung, strict=True):
            performer.put(float(self.times[index]), swung[index])
        if self.ball is not None:
            start, velocity = THROW
            flown = time - self.capture.start
            self.ball.location = start + velocity * flown + np.array([0, 0, -4.905]) * flown**2

    def surface(self) -> tuple[np.ndarray, np.ndarray]:
        """(V, 3) vertices and (T, 3) triangles of all people as they were put last."""
        points, triangles, start = [], [], 0
        for mesh in (mesh for performer in self.performers for mesh in performer.meshes()):
            vertices, quads = np.empty(len(mesh.vertices) * 3, np.float32), np.empty(len(mesh.polygons) * 4, np.int32)
            mesh.vertices.foreach_get("co", vertices)
            mesh.polygons.foreach_get("vertices", quads)
            corners = quads.reshape(-1, 4) + start
            points.append(vertices.reshape(-1, 3))
            triangles += [corners[:, :3], corners[:, [0, 2, 3]]]
            start += len(mesh.vertices)
        return np.vstack(points), np.vstack(triangles)

    def show_people(self, shown: bool) -> None:
        """Show the people, or the set alone, for the clean plates."""
        for layer in self.scene.view_layers:
            layer.layer_collection.children["people"].exclude = not shown

    def box(self, camera: Camera, width: int, height: int, focal: float) -> tuple[int, int, int, int]:
        """Left, top, right and bottom pixel around people, ball and the floor where their shadows are dark."""
        points = self.surface()[0]
        if self.ball is not None:
            points = np.vstack(
                [points, np.array(self.ball.location) + 0.11 * np.mgrid[-1:2, -1:2, -1:2].reshape(3, -1).T]
            )
        floor = [points * (1, 1, 0) + 0.18 * np.array([x, y, 0]) for x in (-1, 1) for y in (-1, 1)]
        rotation, shift = camera.world_to_camera[:, :3], camera.world_to_camera[:, 3]
        seen = np.vstack([points, *floor]) @ rotation.T + shift
        across = np.maximum(np.hypot(seen[:, 0], seen[:, 1]), 1e-9)
        if camera.lens.kind == "fisheye":
            radius = camera.lens.radius(np.arctan2(across, seen[:, 2]))
        else:
            radius = across / np.maximum(seen[:, 2], 0.05)
        x = focal * width * radius * seen[:, 0] / across + width / 2
        y = focal * width * radius * seen[:, 1] / across + height / 2
        margin = BOX_MARGIN * width
        left, right = np.clip([x.min() - margin, x.max() + margin], 0, width).round().astype(int)
        top, bottom = np.clip([y.min() - margin, y.max() + margin], 0, height).round().astype(int)
        return left, top, right, bottom

    def aim(self, camera: Camera, width: int, height: int, focal: float) -> None:
        """Look through a camera, with an image of `width` x `height` and a focal length in widths."""
        data = self.camera.data
        self.scene.render.resolution_x, self.scene.render.resolution_y = width, height
        data.sensor_fit, data.sensor_width = "HORIZONTAL", 36.0
        if camera.lens.kind == "fisheye":
            data.type = "PANO"
            data.panorama_type, data.fisheye_fov = "FISHEYE_LENS_POLYNOMIAL", 3.1
            for power, value in enumerate(_angle_by_radius(camera, 36.0)):
                setattr(data, f"fisheye_polynomial_k{power}", -value)
        else:
            data.type, data.lens = "PERSP", focal * 36.0
        rotation, center = camera.world_to_camera[:, :3], np.array(camera.position)
        pose = np.eye(4)
        pose[:3, :3], pose[:3, 3] = rotation.T @ np.diag((1, -1, -1)), center
        self.camera.matrix_world = Matrix(pose.tolist())

    def shot(self, folder: Path, box: tuple[int, int, int, int] | None, samples: int) -> np.ndarray:
        """(H, W, 5) linear light, matte in [0, 1] and depth in meters as seen now, of the pixels in a box or of all."""
        self.output.base_path = str(folder)
        render, (width, height) = self.scene.render, (self.scene.render.resolution_x, self.scene.render.resolution_y)
        self.scene.cycles.samples = samples
        render.use_border = render.use_crop_to_border = box is not None
        if box is not None:
            left, top, right, bottom = box
            render.border_min_x, render.border_max_x = left / width, right / width
            render.border_min_y, render.border_max_y = 1 - bottom / height, 1 - top / height
        bpy.ops.render.render(scene=self.scene.name)
        number = f"{self.scene.frame_current:04}"
        picture, matte, depth = (_read(folder / f"{slot}{number}.exr") for slot in ("picture", "matte", "depth"))
        return np.dstack([picture[..., :3], np.clip(matte[..., 0], 0, 1), np.minimum(depth[..., 0], 60.0)])


def _angle_by_radius(camera: Camera, sensor: float) -> np.ndarray:
    """(5,) coefficients of the angle by powers of the radius in mm, fitted to the lens's radius by angle."""
    focal = camera.lens.focal * sensor
    angle = np.linspace(0, 1.5, 400)
    radius = focal * camera.lens.radius(angle)
    powers = np.stack([radius**power for power in range(1, 5)], axis=1)
    return np.hstack([0.0, np.linalg.lstsq(powers, angle, rcond=None)[0]])


def _read(path: Path) -> np.ndarray:
    """(H, W, 4) float32 of an EXR file."""
    image = bpy.data.images.load(str(path))
    width, height = image.size
    pixels = np.empty(width * height * 4, np.float32)
    image.pixels.foreach_get(pixels)
    bpy.data.images.remove(image)
    path.unlink()
    return pixels.reshape(height, width, 4)[::-1].copy()
