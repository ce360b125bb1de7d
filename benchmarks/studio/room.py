"""The set: a living room used as a studio, with daylight, lamps and things along its walls, or with a screen.

x runs along the floor's planks, z is up; the performer stands around the origin. Nothing but the rug and the floor is
within 2.8 m of the middle axis, so that cameras there see the performer freely.
"""

import math
from collections.abc import Sequence
from typing import Any

import bpy
import numpy as np
from materials import Color, Nodes, glowing, material, plain

HALF, HEIGHT = 3.7, 2.9  # half of the room's width, and its height, in meters
SILL, LINTEL = 0.75, 2.35  # of the window
WINDOW = 1.1  # half of its width


class Room:
    """Collects the objects of a set in a collection of its own."""

    def __init__(self, scene: bpy.types.Scene, seed: int) -> None:
        self.collection = bpy.data.collections.new("set")
        scene.collection.children.link(self.collection)
        self.random = np.random.default_rng(seed)

    def mesh(
        self, name: str, vertices: Any, faces: Any, made: bpy.types.Material, smooth: bool = False
    ) -> bpy.types.Object:
        """Add a mesh."""
        data = bpy.data.meshes.new(name)
        data.from_pydata(np.asarray(vertices, float).tolist(), [], [list(face) for face in faces])
        data.materials.append(made)
        if smooth:
            data.shade_smooth()
        thing = bpy.data.objects.new(name, data)
        self.collection.objects.link(thing)
        return thing

    def box(
        self, low: Sequence[float], high: Sequence[float], made: bpy.types.Material, turn: float = 0.0
    ) -> bpy.types.Object:
        """Add a box with beveled edges, turned about the vertical axis through its middle (degrees)."""
        low, high = np.asarray(low, float), np.asarray(high, float)
        middle = (low + high) / 2
        signs = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
        faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
        thing = self.mesh("box", signs * (high - low) / 2, faces, made)
        thing.location, thing.rotation_euler = middle, (0, 0, math.radians(turn))
        bevel = thing.modifiers.new("bevel", "BEVEL")
        bevel.width, bevel.segments = min(0.006, float((high - low).min()) / 4), 2
        return thing

    def rod(
        self, start: Sequence[float], end: Sequence[float], radii: tuple[float, float], made: bpy.types.Material
    ) -> None:
        """Add a round rod or cone."""
        start, end = np.asarray(start, float), np.asarray(end, float)
        along = (end - start) / np.linalg.norm(end - start)
        side = np.cross(along, (1, 0, 0) if abs(along[0]) < 0.9 else (0, 1, 0))
        side /= np.linalg.norm(side)
        angles = np.linspace(0, 2 * math.pi, 25)[:-1, None]
        circle = np.cos(angles) * side + np.sin(angles) * np.cross(along, side)
        vertices = np.vstack([start + radii[0] * circle, end + radii[1] * circle])
        faces = [(a, (a + 1) % 24, 24 + (a + 1) % 24, 24 + a) for a in range(24)]
        self.mesh("rod", vertices, [*faces, tuple(range(23, -1, -1)), tuple(range(24, 48))], made)

    def ball(self, center: Sequence[float], radius: float, made: bpy.types.Material) -> bpy.types.Object:
        """Add a sphere."""
        u, v = np.meshgrid(np.linspace(0, 2 * math.pi, 33), np.linspace(0, math.pi, 17))
        points = np.stack([np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)], axis=-1).reshape(-1, 3)
        thing = self.mesh("ball", points * radius, _grid(17, 33), made, smooth=True)
        thing.location = center
        return thing

    def light(
        self, kind: str, place: Sequence[float], toward: Sequence[float], power: float, color: Color, size: Any
    ) -> None:
        """Add a light: `size` is (width, height) of an area, the radius of a point, the angle of the sun (degrees)."""
        data = bpy.data.lights.new(kind.lower(), kind)
        data.energy, data.color = power, color
        if kind == "AREA":
            data.shape, data.size, data.size_y = "RECTANGLE", *size
        elif kind == "SUN":
            data.angle = math.radians(size)
        else:
            data.shadow_soft_size = size
        lamp = bpy.data.objects.new(kind.lower(), data)
        lamp.location = place
        lamp.rotation_euler = _toward(np.asarray(toward, float) - np.asarray(place, float))
        lamp.visible_camera = False
        self.collection.objects.link(lamp)


def _grid(rows: int, columns: int) -> list[tuple[int, int, int, int]]:
    """Quads of a grid of vertices in row-major order."""
    corners = [row * columns + column for row in range(rows - 1) for column in range(columns - 1)]
    return [(a, a + 1, a + columns + 1, a + columns) for a in corners]


def _toward(direction: np.ndarray) -> Any:
    """Euler angles of an object whose -z points in a direction."""
    from mathutils import Vector

    return Vector(direction).to_track_quat("-Z", "Y").to_euler()


def make_room(scene: bpy.types.Scene, seed: int = 7) -> Room:
    """A living room with wooden floor, rug, window, curtain, shelves, chair, plant and lamps."""
    room = Room(scene, seed)
    _shell(room)
    _rug(room)
    _window(room)
    _curtain(room, -1)
    _curtain(room, 1)
    _shelves(room)
    _chair(room, (2.75, -2.75), 40)
    _plant(room, (-3.05, 2.95))
    _sideboard(room)
    _pictures(room)
    _floor_lamp(room, (3.0, 3.05))
    # A softbox below the ceiling, as a studio adds to daylight.
    room.light("AREA", (0, 0, HEIGHT - 0.05), (0, 0, 0), 95.0, (1.0, 0.95, 0.88), (3.2, 3.2))
    room.light("AREA", (HALF + 0.2, 0, 1.6), (0, 0, 1.0), 170.0, (0.78, 0.88, 1.0), (2 * WINDOW, LINTEL - SILL))
    room.light("SUN", (8, 2.5, 5), (0.6, 0.2, 0), 2.6, (1.0, 0.86, 0.68), 0.6)
    world = scene.world or bpy.data.worlds.new("sky")
    scene.world, world.use_nodes = world, True
    world.node_tree.nodes["Background"].inputs[0].default_value = (0.55, 0.7, 1.0, 1.0)
    world.node_tree.nodes["Background"].inputs[1].default_value = 1.2
    return room


def make_screen(scene: bpy.types.Scene, color: Color, whole: bool, seed: int = 7) -> Room:
    """The room with a creased cloth on the floor, and hung around it if `whole`, lit more brightly on one side."""
    room = make_room(scene, seed)
    made, nodes = material("screen")
    place = nodes("ShaderNodeNewGeometry").outputs["Position"]
    creases = nodes.noise(place, 2.2, 6.0)
    nodes.surface(nodes.mix(nodes.math("MULTIPLY", creases, 0.35), color, tuple(0.6 * part for part in color)), 0.9)
    nodes.put(nodes.tree.nodes["Principled BSDF"], "Normal", nodes.bump(creases, 0.05))
    side = HALF - 0.3
    room.box((-side, -side, 0.008), (side, side, 0.012), made)
    if whole:
        angles = np.linspace(0, 2 * math.pi, 241)
        waves = side - 0.1 + 0.02 * np.sin(angles * 90) + 0.02 * np.sin(angles * 37)
        lower = np.stack([waves * np.cos(angles), waves * np.sin(angles), np.full(241, 0.012)], axis=1)
        room.mesh("cloth", np.vstack([lower, lower + np.array([0, 0, 2.8])]), _grid(2, 241), made, smooth=True)
        room.light("AREA", (-2.5, -2.5, 2.8), (0, 0, 0.5), 60.0, (1.0, 1.0, 1.0), (0.8, 0.8))
    return room


def _shell(room: Room) -> None:
    """Floor, walls with the window's opening, ceiling, skirting boards."""
    made, nodes = material("planks")
    place = nodes("ShaderNodeNewGeometry").outputs["Position"]
    board = nodes("ShaderNodeTexBrick", Vector=place, Scale=1.0, Mortar_Size=0.0025, Brick_Width=1.3, Row_Height=0.125)
    for index, color in ((1, (0.2, 0.2, 0.2)), (2, (0.8, 0.8, 0.8)), (3, (0.0, 0.0, 0.0))):
        nodes.put(board, index, color)
    board.offset_frequency, board.offset = 2, 0.37
    tone = nodes("ShaderNodeSeparateColor", Color=board.outputs["Color"]).outputs[0]
    # The grain of each board is another part of the same noise.
    grain = nodes("ShaderNodeVectorMath", properties={"operation": "ADD"}, _0=nodes.stretched(place, (1.4, 17.0, 1.0)))
    nodes.put(grain, 1, board.outputs["Color"])
    rings = nodes.noise(grain.outputs[0], 2.6, 8.0)
    wood = nodes.ramp(rings, [(0.32, (0.16, 0.075, 0.032)), (0.52, (0.30, 0.155, 0.07)), (0.7, (0.42, 0.24, 0.12))])
    toned = nodes.mix(nodes.math("MULTIPLY", tone, 0.5), wood, (0.20, 0.10, 0.05))
    seams = nodes.mix(board.outputs["Fac"], toned, (0.015, 0.008, 0.004))
    gloss = nodes.math("MULTIPLY_ADD", nodes.noise(place, 9.0), 0.16, 0.2)
    nodes.surface(seams, gloss, Normal=nodes.bump(nodes.math("SUBTRACT", rings, board.outputs["Fac"]), 0.0015))
    room.mesh("floor", [(-HALF, -HALF, 0), (HALF, -HALF, 0), (HALF, HALF, 0), (-HALF, HALF, 0)], [(0, 1, 2, 3)], made)

    paint, nodes = material("paint")
    place = nodes("ShaderNodeNewGeometry").outputs["Position"]
    cloudy = nodes.ramp(nodes.noise(place, 1.3, 8.0), [(0.3, (0.50, 0.53, 0.47)), (0.7, (0.56, 0.58, 0.52))])
    nodes.surface(cloudy, 0.85, Normal=nodes.bump(nodes.noise(place, 160.0, 3.0), 0.001))
    white = plain("white", (0.72, 0.71, 0.68), 0.6)
    thick, side = 0.16, HALF
    for low, high in (
        ((-side, side, 0), (side, side + thick, HEIGHT)),
        ((-side, -side - thick, 0), (side, -side, HEIGHT)),
        ((-side - thick, -side, 0), (-side, side, HEIGHT)),
        ((side, -side, 0), (side + thick, -WINDOW, HEIGHT)),
        ((side, WINDOW, 0), (side + thick, side, HEIGHT)),
        ((side, -WINDOW, 0), (side + thick, WINDOW, SILL)),
        ((side, -WINDOW, LINTEL), (side + thick, WINDOW, HEIGHT)),
    ):
        room.box(low, high, paint)
    room.box((-side, -side, HEIGHT), (side, side, HEIGHT + 0.1), white)
    for low, high in (
        ((-side, side - 0.02, 0), (side, side, 0.11)),
        ((-side, -side, 0), (side, -side + 0.02, 0.11)),
        ((-side, -side, 0), (-side + 0.02, side, 0.11)),
        ((side - 0.02, -side, 0), (side, side, 0.11)),
    ):
        room.box(low, high, white)


def _rug(room: Room) -> None:
    """A woven rug with a border and diamonds; its pile moves no one's feet."""
    made, nodes = material("rug")
    place = nodes("ShaderNodeNewGeometry").outputs["Position"]
    x, y, _ = nodes.axes(place)
    red, blue = (0.32, 0.045, 0.03), (0.035, 0.06, 0.11)
    diamond = nodes.math("ADD", *(nodes.math("PINGPONG", nodes.math("ADD", axis, 0.2), 0.2) for axis in (x, y)))
    bands = nodes.ramp(
        nodes.math("MULTIPLY", diamond, 2.5),
        [(0.0, red), (0.3, (0.55, 0.42, 0.25)), (0.38, blue), (0.62, red), (0.8, (0.5, 0.2, 0.06))],
        constant=True,
    )
    sides = ((x, 1.45), (y, 1.1))
    edge = nodes.math("MAXIMUM", *(nodes.math("DIVIDE", nodes.math("ABSOLUTE", axis), half) for axis, half in sides))
    border = nodes.mix(nodes.math("GREATER_THAN", edge, 0.86), bands, blue)
    line = nodes.mix(nodes.math("COMPARE", edge, 0.86, 0.012), border, (0.55, 0.42, 0.25))
    fuzzy = nodes.mix(nodes.math("MULTIPLY", nodes.noise(place, 190.0, 2.0), 0.5), line, (0.02, 0.015, 0.012))
    nodes.surface(fuzzy, 0.95, Sheen_Weight=0.3, Normal=nodes.bump(nodes.noise(place, 420.0, 2.0), 0.004))
    room.box((-1.45, -1.1, 0), (1.45, 1.1, 0.008), made)


def _window(room: Room) -> None:
    white = plain("frame", (0.75, 0.74, 0.71), 0.4)
    depth = (HALF + 0.05, HALF + 0.11)
    for y in (-WINDOW, -0.03, WINDOW - 0.06):
        room.box((depth[0], y, SILL), (depth[1], y + 0.06, LINTEL), white)
    for z in (SILL, (SILL + LINTEL) / 2 + 0.2, LINTEL - 0.06):
        room.box((depth[0], -WINDOW, z), (depth[1], WINDOW, z + 0.05), white)
    room.box((HALF - 0.16, -WINDOW - 0.08, SILL - 0.04), (HALF + 0.05, WINDOW + 0.08, SILL), white)
    # What one sees outside: a sky and a hedge, out of focus.
    made, nodes = material("outside")
    place = nodes("ShaderNodeNewGeometry").outputs["Position"]
    height = nodes.math("ADD", nodes.axes(place)[2], nodes.math("MULTIPLY", nodes.noise(place, 1.4, 3.0), 0.9))
    view = nodes.ramp(
        nodes.math("DIVIDE", height, 4.0),
        [(0.28, (0.05, 0.11, 0.03)), (0.42, (0.16, 0.25, 0.07)), (0.47, (0.75, 0.85, 1.0)), (1.0, (0.35, 0.58, 1.0))],
    )
    light = nodes("ShaderNodeEmission", Color=view, Strength=3.2)
    nodes("ShaderNodeOutputMaterial", Surface=light.outputs[0])
    outside = room.mesh("outside", [(7, -8, -2), (7, 8, -2), (7, 8, 6), (7, -8, 6)], [(0, 1, 2, 3)], made)
    outside.visible_shadow = False


def _curtain(room: Room, side: int) -> None:
    made, nodes = material("curtain")
    place = nodes("ShaderNodeNewGeometry").outputs["Position"]
    threads = nodes.math("MULTIPLY", nodes.noise(place, 120.0, 2.0), 0.4)
    color = nodes.mix(threads, (0.62, 0.30, 0.10), (0.30, 0.12, 0.04))
    nodes.surface(color, 0.9, Sheen_Weight=0.3)
    along, up = np.meshgrid(np.linspace(0, 1, 160), np.linspace(0, 1, 40))
    width = 0.62 + 0.1 * (1 - up)
    waves = 0.05 * np.sin(along * 2 * math.pi * 8 + 0.8 * np.sin(up * 3)) * (0.6 + 0.5 * (1 - up))
    points = np.stack(
        [HALF - 0.13 + waves, side * (WINDOW + 0.42 - width * along), 0.03 + (LINTEL + 0.14) * up], axis=-1
    ).reshape(-1, 3)
    faces = _grid(40, 160)
    room.mesh("curtain", points, faces, made, smooth=True)
    rail = plain("rail", (0.05, 0.04, 0.035), 0.3, Metallic=1.0)
    room.rod((HALF - 0.13, -2.2, LINTEL + 0.2), (HALF - 0.13, 2.2, LINTEL + 0.2), (0.014, 0.014), rail)


def _wood(name: str, dark: Color, light: Color) -> bpy.types.Material:
    made, nodes = material(name)
    place = nodes("ShaderNodeTexCoord").outputs["Object"]
    rings = nodes.noise(nodes.stretched(place, (3.0, 3.0, 30.0)), 1.5, 7.0)
    nodes.surface(nodes.ramp(rings, [(0.35, dark), (0.65, light)]), 0.35, Normal=nodes.bump(rings, 0.0008))
    return made


def _shelves(room: Room) -> None:
    """A shelf full of books along the wall opposite to the window."""
    wood = _wood("oak", (0.25, 0.14, 0.06), (0.42, 0.26, 0.13))
    back, front = -HALF + 0.01, -HALF + 0.30
    low, high = -1.6, 0.9
    for y in np.linspace(low, high, 4):
        room.box((back, y - 0.012, 0), (front, y + 0.012, 2.02), wood)
    for z in (0.04, 0.43, 0.82, 1.21, 1.60, 2.0):
        room.box((back, low, z), (front, high, z + 0.024), wood)
    covers = [
        plain(f"cover {index}", color, 0.5)
        for index, color in enumerate(
            [(0.35, 0.04, 0.03), (0.03, 0.09, 0.22), (0.55, 0.45, 0.28), (0.04, 0.14, 0.08), (0.6, 0.58, 0.52),
             (0.02, 0.02, 0.025), (0.5, 0.22, 0.03), (0.16, 0.05, 0.15), (0.08, 0.25, 0.28), (0.62, 0.5, 0.1)]
        )
    ]  # fmt: skip
    random = room.random
    for z in (0.064, 0.454, 0.844, 1.234, 1.624):
        for bay in range(3):
            y = low + bay * (high - low) / 3 + 0.03
            end = low + (bay + 1) * (high - low) / 3 - 0.05
            end -= random.uniform(0.0, 0.3)
            while y < end:
                width, tall = random.uniform(0.018, 0.05), random.uniform(0.2, 0.32)
                deep = random.uniform(0.16, 0.24)
                cover = covers[int(random.integers(len(covers)))]
                room.box((back + 0.02, y, z), (back + 0.02 + deep, y + width * 0.94, z + tall), cover)
                y += width


def _chair(room: Room, place: tuple[float, float], turn: float) -> None:
    wood = _wood("beech", (0.4, 0.24, 0.12), (0.55, 0.36, 0.2))
    seat = plain("seat", (0.05, 0.17, 0.18), 0.9, Sheen_Weight=0.5)
    angle = math.radians(turn)
    rotation = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])

    def at(x: float, y: float, z: float) -> tuple[float, float, float]:
        return (*(rotation @ (x, y) + place), z)

    for x in (-0.2, 0.2):
        room.rod(at(x, 0.2, 0), at(x * 0.92, 0.18, 0.46), (0.014, 0.02), wood)
        room.rod(at(x, -0.22, 0), at(x * 0.92, -0.2, 0.92), (0.014, 0.017), wood)
    middle = at(0, 0, 0.46)
    room.box(np.subtract(middle, (0.225, 0.22, 0.03)), np.add(middle, (0.225, 0.22, 0.035)), seat, turn)
    for z in (0.62, 0.74, 0.86):
        middle = at(0, -0.2, z)
        room.box(np.subtract(middle, (0.2, 0.012, 0.035)), np.add(middle, (0.2, 0.012, 0.035)), wood, turn)


def _plant(room: Room, place: tuple[float, float]) -> None:
    """A rubber plant: leaves on bent stems."""
    pot = plain("terracotta", (0.38, 0.13, 0.06), 0.8)
    room.rod((*place, 0), (*place, 0.34), (0.15, 0.2), pot)
    room.rod((*place, 0.33), (*place, 0.345), (0.18, 0.18), plain("soil", (0.02, 0.012, 0.008), 1.0))
    stem = plain("stem", (0.12, 0.1, 0.04), 0.7)
    leaves = [plain(f"leaf {n}", (0.03, 0.12 + 0.04 * n, 0.03), 0.28) for n in range(3)]
    random = room.random
    for _ in range(7):
        angle, tilt = random.uniform(0, 2 * math.pi), random.uniform(0.1, 0.34)
        base = np.array([*place, 0.33])
        tall = random.uniform(0.75, 1.35)
        for step in range(8):
            before, point = (
                np.add(base, (math.cos(angle) * tilt * u**1.6, math.sin(angle) * tilt * u**1.6, tall * u))
                for u in (step / 8, (step + 1) / 8)
            )
            room.rod(before, point, (0.011 - 0.001 * step, 0.010 - 0.001 * step), stem)
            turn = angle + step * 2.4
            length, droop = random.uniform(0.16, 0.26), random.uniform(0.2, 0.8)
            _leaf(room, point, turn, length, droop, leaves[int(random.integers(3))])


def _leaf(room: Room, base: np.ndarray, turn: float, length: float, droop: float, made: bpy.types.Material) -> None:
    rows = np.linspace(0, 1, 9)
    width = 0.34 * length * np.sin(math.pi * np.clip(rows * 0.96 + 0.02, 0, 1)) ** 0.8
    out, up = length * (rows - 0.15 * droop * rows**2), length * (0.45 * rows - droop * rows**2)
    points = []
    for column in (-1, 0, 1):
        side = column * width
        lift = up + 0.12 * np.abs(side)
        x, y = (out * math.cos(turn) - side * math.sin(turn), out * math.sin(turn) + side * math.cos(turn))
        points.append(np.stack([x, y, lift], axis=1) + base)
    faces = _grid(3, 9)
    room.mesh("leaf", np.vstack(points), faces, made, smooth=True)


def _sideboard(room: Room) -> None:
    """Along the wall behind: a low cupboard with a table lamp, a bowl and a vase."""
    wood = _wood("walnut", (0.10, 0.045, 0.02), (0.2, 0.1, 0.05))
    dark = plain("handle", (0.4, 0.33, 0.2), 0.3, Metallic=1.0)
    clay = plain("vase", (0.6, 0.58, 0.52), 0.25)
    y = HALF - 0.24
    room.box((-1.3, HALF - 0.45, 0.14), (0.9, HALF - 0.02, 0.72), wood)
    for x in (-1.2, 0.8):
        room.rod((x, HALF - 0.38, 0), (x, HALF - 0.36, 0.15), (0.012, 0.02), wood)
    for x in (-0.56, 0.17):
        room.box((x - 0.003, HALF - 0.455, 0.16), (x + 0.003, HALF - 0.449, 0.70), plain("gap", (0.01, 0.006, 0.004)))
    for x in (-0.66, 0.07, 0.27):
        room.rod((x, HALF - 0.47, 0.40), (x, HALF - 0.47, 0.52), (0.008, 0.008), dark)
    room.rod((-0.95, y, 0.72), (-0.95, y, 1.02), (0.05, 0.018), plain("ceramic", (0.08, 0.2, 0.26), 0.15))
    room.rod((-0.95, y, 1.0), (-0.95, y, 1.24), (0.16, 0.1), glowing("shade", (1.0, 0.68, 0.36), 3.0))
    room.light("POINT", (-0.95, y, 1.3), (0, 0, 0), 14.0, (1.0, 0.66, 0.36), 0.06)
    room.ball((0.1, y, 0.79), 0.07, clay)
    room.rod((0.1, y, 0.83), (0.1, y, 0.98), (0.022, 0.034), clay)
    room.rod((0.55, y, 0.72), (0.55, y, 0.78), (0.07, 0.15), plain("bowl", (0.45, 0.2, 0.05), 0.4))


def _pictures(room: Room) -> None:
    """Framed prints on two walls: hills, rings, stripes and cells."""
    frame = plain("black frame", (0.015, 0.014, 0.013), 0.3)
    hung = (
        (1, -0.2, 0.75, 0.55, _hills),
        (-1, -1.5, 0.6, 0.8, _rings),
        (-1, -0.6, 0.6, 0.8, _stripes),
        (-1, 1.2, 1.1, 0.7, _cells),
    )
    for wall, x, wide, tall, pattern in hung:
        made, nodes = material(pattern.__name__)
        nodes.surface(pattern(nodes, nodes("ShaderNodeTexCoord").outputs["Object"]), 0.5)
        y = wall * (HALF - 0.02)
        low, high = np.array((x - wide / 2, y, 1.5 - tall / 2)), np.array((x + wide / 2, y, 1.5 + tall / 2))
        room.box(np.subtract(low, (0.02, 0.015, 0.02)), np.add(high, (0.02, 0.015, 0.02)), frame)
        y = -wall * 0.018
        room.box(np.add(low, (0, y - 0.002, 0)), np.add(high, (0, y + 0.002, 0)), made)


def _hills(nodes: Nodes, place: Any) -> Any:
    bent = nodes.math("MULTIPLY", nodes.noise(place, 3.0), 0.8)
    waves = nodes.math("ADD", nodes.math("MULTIPLY", nodes.axes(place)[2], 2.2), bent)
    stops = [(0.1, (0.04, 0.1, 0.16)), (0.35, (0.12, 0.3, 0.32)), (0.5, (0.7, 0.55, 0.35)), (0.62, (0.8, 0.4, 0.18))]
    return nodes.ramp(waves, stops, constant=True)


def _rings(nodes: Nodes, place: Any) -> Any:
    radius = nodes("ShaderNodeVectorMath", properties={"operation": "LENGTH"}, _0=place).outputs["Value"]
    stops = [(0.0, (0.75, 0.72, 0.64)), (0.45, (0.5, 0.06, 0.03)), (0.75, (0.02, 0.02, 0.02))]
    return nodes.ramp(nodes.math("FRACT", nodes.math("MULTIPLY", radius, 7.0)), stops, constant=True)


def _stripes(nodes: Nodes, place: Any) -> Any:
    x, _, z = nodes.axes(place)
    slanted = nodes.math("FRACT", nodes.math("MULTIPLY", nodes.math("ADD", x, z), 5.0))
    return nodes.ramp(slanted, [(0.0, (0.7, 0.5, 0.05)), (0.5, (0.05, 0.16, 0.2))], constant=True)


def _cells(nodes: Nodes, place: Any) -> Any:
    distance = nodes("ShaderNodeTexVoronoi", Vector=place, Scale=9.0).outputs["Distance"]
    return nodes.ramp(distance, [(0.1, (0.02, 0.05, 0.12)), (0.4, (0.5, 0.62, 0.6)), (0.8, (0.8, 0.75, 0.6))])


def _floor_lamp(room: Room, place: tuple[float, float]) -> None:
    metal = plain("brass", (0.5, 0.36, 0.12), 0.25, Metallic=1.0)
    room.rod((*place, 0), (*place, 0.02), (0.16, 0.16), metal)
    room.rod((*place, 0.02), (*place, 1.5), (0.011, 0.011), metal)
    room.rod((*place, 1.42), (*place, 1.74), (0.22, 0.15), glowing("lamp shade", (1.0, 0.72, 0.42), 2.6))
    room.light("POINT", (*place, 1.85), (0, 0, 0), 22.0, (1.0, 0.68, 0.38), 0.08)
