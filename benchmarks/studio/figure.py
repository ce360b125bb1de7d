"""The performer as objects of Blender: body, eyes, clothes and hair, which follow the motion frame after frame."""

import functools
from dataclasses import dataclass, field
from typing import Any

import bpy
import numpy as np
from body import Body, data_folder, load_body
from cloth import Hair, Skirt, normals_of, skull
from materials import Color, Nodes, material, plain
from motion import bones_at

SHAPE = {
    "macrodetails/caucasian-female-young": 0.6,
    "macrodetails/asian-female-young": 0.4,
    "macrodetails/proportions/female-young-averagemuscle-averageweight-idealproportions": 0.7,
    "expression/units/caucasian/mouth-corner-puller": 0.8,
    "expression/units/caucasian/mouth-part-later": 0.25,
}


@dataclass
class Piece:
    """A mesh that is posed with the body: its vertices, and how far each is pushed out along its normal."""

    mesh: bpy.types.Mesh
    indices: np.ndarray  # (N,) of the body's vertices
    faces: np.ndarray  # (F, 4) of the piece's vertices
    offset: np.ndarray  # (N,) meters


@dataclass
class Performer:
    """A person in the scene. `place`: (3,) where she stands; `delay`: seconds by which her motion is late."""

    body: Body
    place: np.ndarray
    delay: float
    pieces: list[Piece] = field(default_factory=list)
    objects: list[bpy.types.Object] = field(default_factory=list)

    def __post_init__(self) -> None:
        self._known = functools.lru_cache(100_000)(lambda time: bones_at(self.body, time))

    def bones(self, time: float) -> np.ndarray:
        """(B, 4, 4) bone transforms at a time in seconds of her motion; each is computed once."""
        return self._known(round(time, 6))

    def put(self, time: float, skirt: np.ndarray) -> None:
        """Move everything to where it is at a time in seconds; `skirt`: (S, 3) from `Skirt.simulate`."""
        posed = self.body.posed(self.bones(time - self.delay)) + self.place
        for piece in self.pieces:
            vertices = posed[piece.indices]
            if piece.offset.any():
                vertices = vertices + piece.offset[:, None] * normals_of(vertices, piece.faces)
            _move(piece.mesh, vertices)
        _move(self.skirt_mesh, skirt + self.place)
        strands = self.hair.at(self.bones, time - self.delay) + self.place
        self.strands.points.foreach_set("position", strands.astype(np.float32).ravel())
        self.strands.update_tag()

    def meshes(self) -> list[bpy.types.Mesh]:
        """All surfaces as they were put last; hair is none."""
        return [*(piece.mesh for piece in self.pieces), self.skirt_mesh]


def make_performer(place: tuple[float, float, float], delay: float, colors: dict[str, Color], seed: int) -> Performer:
    """A dressed person. `colors`: of "hair", "top", "stripe", "skirt", "check", "legs" and "shoes", linear RGB."""
    body = load_body(SHAPE)
    her = Performer(body, np.array(place), delay)
    rest = body.vertices
    height = {
        name: body.bones[body.bone(name)].head[2] for name in ("neck01", "upperleg01.L", "lowerleg01.L", "foot.L")
    }
    waist = height["upperleg01.L"] + 0.13
    shoulder, wrist = (body.bones[body.bone(name)].head for name in ("upperarm01.L", "wrist.L"))
    along = (wrist - shoulder) / np.linalg.norm(wrist - shoulder)
    arm = (np.abs(rest) * (1, 0, 0) + rest * (0, 1, 1) - shoulder) @ along  # meters from the shoulder along either arm
    tights = body.members("helper-tights")
    skin = body.members("body")

    sleeve = 0.27
    lower = np.abs(rest[:, 0]) < 0.24
    in_top = tights & (rest[:, 2] > waist - 0.09) & (arm < sleeve) & (rest[:, 2] < height["neck01"] - 0.015)
    in_top &= lower | (arm > 0)
    in_legs = tights & (rest[:, 2] < waist) & (rest[:, 2] > height["foot.L"] - 0.005) & lower
    is_shoe = skin & (rest[:, 2] < height["foot.L"] - 0.012)
    covered = skin & (rest[:, 2] < height["neck01"] - 0.05) & (arm < sleeve - 0.03) & (lower | (arm > 0))
    covered &= rest[:, 2] > height["foot.L"] + 0.01
    tucked = np.clip((rest[:, 2] - waist) / 0.06, 0, 1)  # the top lies close to the body where the skirt is over it

    random = np.random.default_rng(seed)
    _piece(her, "skin", body.faces_of(skin & ~covered & ~is_shoe), _skin(), subdivided=True)
    _piece(
        her,
        "top",
        body.faces_of(in_top),
        _knit(colors["top"], colors["stripe"]),
        0.002 + tucked * (0.003 + 0.006 * _folds(rest, random)),
    )
    _piece(her, "legs", body.faces_of(in_legs), _woven(colors["legs"], 420.0), 0.002 + 0.002 * _folds(rest, random))
    _piece(her, "shoes", body.faces_of(is_shoe), plain("shoes", colors["shoes"], 0.35), np.full(len(rest), 0.006))
    for side in "lr":
        eye = body.members(f"helper-{side}-eye")
        _piece(her, f"eye {side}", body.faces_of(eye), _eye(rest[eye].mean(axis=0)), subdivided=True)
        lashes = body.members(f"helper-{side}-eyelashes-1", f"helper-{side}-eyelashes-2")
        _piece(her, f"lashes {side}", body.faces_of(lashes), plain("lashes", (0.01, 0.006, 0.004)))
    _piece(her, "teeth", body.faces_of(body.members("helper-upper-teeth")), plain("teeth", (0.7, 0.66, 0.58), 0.2))

    her.skirt = Skirt(body, waist - 0.02, height["lowerleg01.L"] - 0.02)
    her.skirt_mesh = _mesh("skirt", her.skirt.rest, her.skirt.faces, body.uvs[her.skirt.quads], her.skirt.rest)
    her.objects.append(_object("skirt", her.skirt_mesh, _checked(colors["skirt"], colors["check"]), thickness=0.0015))
    _add_hair(her, colors["hair"], seed)
    return her


def _add_hair(her: Performer, color: Color, seed: int) -> None:
    """Strands on the scalp."""
    body, random = her.body, np.random.default_rng(seed + 1)
    rest = body.vertices
    center, radii = skull(body)
    faces = body.faces_of(body.members("body") & (rest[:, 2] > center[2] - 0.09))
    corners = rest[body.faces[faces]]
    areas = np.linalg.norm(np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1]), axis=1)
    chosen = random.choice(len(faces), 60_000, p=areas / areas.sum())
    u, v = random.random((2, 60_000, 1))
    quad = corners[chosen]
    roots = (1 - v) * ((1 - u) * quad[:, 0] + u * quad[:, 1]) + v * ((1 - u) * quad[:, 3] + u * quad[:, 2])
    away = (roots - center) / radii
    away /= np.linalg.norm(away, axis=1, keepdims=True)
    # The hairline's height by direction: high at the forehead, past the temples down to the nape.
    hairline = np.interp(away[:, 1], [-1.0, -0.75, -0.45, -0.15, 0.1, 0.5], [0.62, 0.58, 0.42, 0.05, -0.35, -0.75])
    kept = np.flatnonzero(away[:, 2] > hairline)[:20_000]
    her.hair = Hair(body, roots[kept], away[kept], 0.25, seed)
    strands = her.hair.strands
    curves = bpy.data.hair_curves.new("hair")
    curves.add_curves([strands.shape[1]] * len(strands))
    radius = curves.attributes.new("radius", "FLOAT", "POINT")
    tapered = 0.00045 * (1 - 0.75 * np.linspace(0, 1, strands.shape[1]) ** 2)
    radius.data.foreach_set("value", np.tile(tapered, len(strands)).astype(np.float32))
    made, nodes = material("hair")
    shader = nodes("ShaderNodeBsdfHairPrincipled", Color=color, Roughness=0.32, Random_Roughness=0.3)
    shader.parametrization = "COLOR"
    nodes("ShaderNodeOutputMaterial", Surface=shader.outputs[0])
    her.strands = curves
    her.objects.append(_object("hair", curves, made))


def _piece(
    her: Performer, name: str, faces: np.ndarray, made: bpy.types.Material, offset: Any = None, subdivided: bool = False
) -> None:
    """Add faces of the body as an object of their own. `offset`: (V,) of the body's vertices, meters."""
    body = her.body
    indices, inverse = np.unique(body.faces[faces], return_inverse=True)
    own = inverse.reshape(-1, 4)
    pushed = np.zeros(len(indices)) if offset is None else np.asarray(offset)[indices]
    mesh = _mesh(name, body.vertices[indices], own, body.uvs[faces], body.vertices[indices])
    her.pieces.append(Piece(mesh, indices, own, pushed))
    her.objects.append(_object(name, mesh, made, subdivided=subdivided or offset is not None))


def _mesh(name: str, vertices: np.ndarray, faces: np.ndarray, uvs: np.ndarray, rest: np.ndarray) -> bpy.types.Mesh:
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(vertices.tolist(), [], faces.tolist())
    mesh.attributes.new("rest", "FLOAT_VECTOR", "POINT").data.foreach_set("vector", rest.astype(np.float32).ravel())
    mesh.uv_layers.new(name="UVMap").data.foreach_set("uv", uvs.astype(np.float32).ravel())
    mesh.shade_smooth()
    return mesh


def _object(
    name: str, data: Any, made: bpy.types.Material, subdivided: bool = False, thickness: float = 0.0
) -> bpy.types.Object:
    thing = bpy.data.objects.new(name, data)
    data.materials.append(made)
    if thickness:
        thing.modifiers.new("thickness", "SOLIDIFY").thickness = thickness
    if subdivided or thickness:
        smooth = thing.modifiers.new("smooth", "SUBSURF")
        smooth.levels = smooth.render_levels = 1
    return thing


def _move(mesh: bpy.types.Mesh, vertices: np.ndarray) -> None:
    mesh.vertices.foreach_set("co", vertices.astype(np.float32).ravel())
    mesh.update()


def _folds(rest: np.ndarray, random: np.random.Generator) -> np.ndarray:
    """(V,) in [-1, 1]: folds of cloth, as a sum of waves that run around the body."""
    result = np.zeros(len(rest))
    for octave in range(7):
        direction = random.normal(0, 1, 3) * (1, 1, 0.7)
        direction /= np.linalg.norm(direction)
        wave = 22 * 1.45**octave
        bent = rest @ direction + 0.02 * np.sin(rest @ np.roll(direction, 1) * 17 + random.uniform(0, 6))
        result += np.sin(wave * bent + random.uniform(0, 6)) / 1.3**octave
    return result / 3


def _skin() -> bpy.types.Material:
    made, nodes = material("skin")
    rest = nodes.attribute("rest")
    blotches = nodes.noise(rest, 28.0, 6.0)
    color = nodes.ramp(blotches, [(0.3, (0.60, 0.33, 0.24)), (0.7, (0.68, 0.42, 0.31))])
    for name, tint, amount in (("lips", (0.50, 0.13, 0.12), 0.8), ("fingernails", (0.72, 0.42, 0.36), 0.7)):
        image = bpy.data.images.load(str(data_folder() / "textures" / f"mpfb_{name}.jpg"))
        image.colorspace_settings.name = "Non-Color"
        mask = nodes("ShaderNodeTexImage", properties={"image": image}).outputs["Color"]
        color = nodes.mix(nodes.math("MULTIPLY", mask, amount, clamp=True), color, tint)
    pores = nodes.bump(nodes.noise(rest, 900.0, 2.0), 0.0006, 0.5)
    nodes.surface(
        color, 0.42, Subsurface_Weight=0.22, Subsurface_Radius=(0.012, 0.005, 0.003), Subsurface_Scale=1.0, Normal=pores
    )
    return made


def _eye(center: np.ndarray) -> bpy.types.Material:
    """White, iris and pupil by the distance from the axis of sight."""
    made, nodes = material("eye")
    x, y, z = nodes.axes(nodes.attribute("rest"))
    across, up = nodes.math("SUBTRACT", x, float(center[0])), nodes.math("SUBTRACT", z, float(center[2]))
    distance = nodes.math(
        "SQRT", nodes.math("ADD", nodes.math("MULTIPLY", across, across), nodes.math("MULTIPLY", up, up))
    )
    front = nodes.math("LESS_THAN", y, float(center[1]))
    scaled = nodes.math("ADD", nodes.math("MULTIPLY", distance, 80.0), nodes.math("SUBTRACT", 1.0, front), clamp=True)
    stops = [
        (0.0, (0.004, 0.003, 0.003)),
        (0.20, (0.10, 0.17, 0.12)),
        (0.44, (0.03, 0.05, 0.04)),
        (0.50, (0.74, 0.70, 0.66)),
    ]
    nodes.surface(nodes.ramp(scaled, stops), 0.08, Coat_Weight=0.8)
    return made


def _weave(nodes: Nodes, place: Any, scale: float) -> Any:
    """Height in [0, 1] of threads in two directions."""
    x, y, z = nodes.axes(nodes.stretched(place, (scale, scale, scale)))
    over = nodes.math("SINE", nodes.math("ADD", x, y))
    under = nodes.math("SINE", z)
    return nodes.math("MULTIPLY_ADD", nodes.math("MULTIPLY", over, under), 0.5, 0.5)


def _knit(color: Color, stripe: Color) -> bpy.types.Material:
    """A striped jersey."""
    made, nodes = material("knit")
    place = nodes.attribute("rest")
    bent = nodes.math("ADD", nodes.axes(place)[2], nodes.math("MULTIPLY", nodes.noise(place, 6.0), 0.012))
    phase = nodes.math("FRACT", nodes.math("MULTIPLY", bent, 1 / 0.042))
    striped = nodes.mix(nodes.math("GREATER_THAN", phase, 0.62), color, stripe)
    soft = nodes.mix(nodes.math("MULTIPLY", nodes.noise(place, 60.0), 0.35), striped, (0.02, 0.02, 0.03))
    nodes.surface(soft, 0.85, Sheen_Weight=0.25, Normal=nodes.bump(_weave(nodes, place, 1500.0), 0.0008))
    return made


def _woven(color: Color, scale: float) -> bpy.types.Material:
    made, nodes = material("woven")
    place = nodes.attribute("rest")
    soft = nodes.mix(nodes.math("MULTIPLY", nodes.noise(place, 40.0), 0.5), color, tuple(0.45 * part for part in color))
    nodes.surface(soft, 0.8, Sheen_Weight=0.2, Normal=nodes.bump(_weave(nodes, place, scale * 3), 0.0008))
    return made


def _checked(color: Color, check: Color) -> bpy.types.Material:
    """A woven check, lines around the body and along it."""
    made, nodes = material("checked")
    place = nodes.attribute("rest")
    x, y, z = nodes.axes(place)
    around = nodes.math("MULTIPLY", nodes.math("ARCTAN2", y, x), 18 / (2 * np.pi))
    lines = [nodes.math("FRACT", around), nodes.math("FRACT", nodes.math("MULTIPLY", z, 1 / 0.075))]
    wide = nodes.math("ADD", *(nodes.math("LESS_THAN", line, 0.34) for line in lines))
    thin = nodes.math("ADD", *(nodes.math("COMPARE", line, 0.67, 0.03) for line in lines), clamp=True)
    plaid = nodes.mix(nodes.math("MULTIPLY", wide, 0.45), color, check)
    plaid = nodes.mix(nodes.math("MULTIPLY", thin, 0.8), plaid, (0.75, 0.68, 0.5))
    soft = nodes.mix(nodes.math("MULTIPLY", nodes.noise(place, 50.0), 0.3), plaid, (0.03, 0.02, 0.02))
    nodes.surface(soft, 0.9, Sheen_Weight=0.3, Normal=nodes.bump(_weave(nodes, place, 1200.0), 0.001))
    return made
