"""Materials of Blender's Cycles, described as trees of nodes in a few words."""

from collections.abc import Sequence
from typing import Any

import bpy

Color = tuple[float, float, float]


class Nodes:
    """The nodes of a material or world: `nodes("ShaderNodeTexNoise", Scale=3.0)` adds one with inputs set by name."""

    def __init__(self, tree: bpy.types.NodeTree) -> None:
        self.tree = tree
        tree.nodes.clear()

    def __call__(self, kind: str, *, properties: dict[str, Any] | None = None, **inputs: Any) -> bpy.types.Node:
        """Add a node. Inputs are values or outputs of other nodes; underscores in their names stand for spaces."""
        node = self.tree.nodes.new(kind)
        for name, value in (properties or {}).items():
            setattr(node, name, value)
        for name, value in inputs.items():
            self.put(node, int(name[1:]) if name[0] == "_" else name.replace("_", " "), value)
        return node

    def put(self, node: bpy.types.Node, name: str | int, value: Any) -> None:
        """Set an input, or connect an output to it."""
        socket = node.inputs[name]
        if isinstance(value, bpy.types.NodeSocket):
            self.tree.links.new(value, socket)
        elif isinstance(value, tuple) and len(value) == 3 and socket.type == "RGBA":
            socket.default_value = (*value, 1.0)
        else:
            socket.default_value = value

    def math(self, operation: str, *values: Any, clamp: bool = False) -> bpy.types.NodeSocket:
        """The result of a scalar operation."""
        node = self("ShaderNodeMath", properties={"operation": operation, "use_clamp": clamp})
        for index, value in enumerate(values):
            self.put(node, index, value)
        return node.outputs[0]

    def ramp(self, factor: bpy.types.NodeSocket, stops: Sequence[tuple[float, Color]], constant: bool = False) -> Any:
        """A color by a factor in [0, 1]."""
        node = self("ShaderNodeValToRGB", Fac=factor)
        elements = node.color_ramp.elements
        while len(elements) < len(stops):
            elements.new(0.5)
        for element, (position, color) in zip(elements, stops, strict=True):
            element.position, element.color = position, (*color, 1.0)
        if constant:
            node.color_ramp.interpolation = "CONSTANT"
        return node.outputs["Color"]

    def mix(self, factor: Any, first: Any, second: Any) -> bpy.types.NodeSocket:
        """A color between two."""
        node = self("ShaderNodeMix", properties={"data_type": "RGBA"})
        for index, value in ((0, factor), (6, first), (7, second)):
            self.put(node, index, value)
        return node.outputs[2]

    def attribute(self, name: str) -> bpy.types.NodeSocket:
        """A vector that each vertex has, such as its place at rest: patterns stick to what moves."""
        return self("ShaderNodeAttribute", properties={"attribute_name": name}).outputs["Vector"]

    def axes(self, vector: bpy.types.NodeSocket) -> Sequence[bpy.types.NodeSocket]:
        """x, y and z of a vector."""
        return self("ShaderNodeSeparateXYZ", Vector=vector).outputs

    def noise(self, vector: bpy.types.NodeSocket, scale: float, detail: float = 4.0) -> bpy.types.NodeSocket:
        """Fractal noise in [0, 1]."""
        return self("ShaderNodeTexNoise", Vector=vector, Scale=scale, Detail=detail).outputs[0]

    def stretched(self, vector: bpy.types.NodeSocket, scale: Color) -> bpy.types.NodeSocket:
        """A vector times a scale by axis."""
        node = self("ShaderNodeVectorMath", properties={"operation": "MULTIPLY"}, _0=vector, _1=scale)
        return node.outputs[0]

    def bump(self, height: bpy.types.NodeSocket, distance: float, strength: float = 1.0) -> bpy.types.NodeSocket:
        """A normal from a height in [0, 1] times `distance` in meters."""
        return self("ShaderNodeBump", Height=height, Distance=distance, Strength=strength).outputs[0]

    def surface(self, color: Any, roughness: Any = 0.6, **inputs: Any) -> None:
        """Finish with a principled surface."""
        shader = self("ShaderNodeBsdfPrincipled", Base_Color=color, Roughness=roughness, **inputs)
        self("ShaderNodeOutputMaterial", Surface=shader.outputs[0])


def material(name: str) -> tuple[bpy.types.Material, Nodes]:
    """A new material and its empty tree."""
    made = bpy.data.materials.new(name)
    made.use_nodes = True
    return made, Nodes(made.node_tree)


def plain(name: str, color: Color, roughness: float = 0.6, **inputs: Any) -> bpy.types.Material:
    """A material of one color."""
    made, nodes = material(name)
    nodes.surface(color, roughness, **inputs)
    return made


def glowing(name: str, color: Color, strength: float) -> bpy.types.Material:
    """A material that is a light."""
    made, nodes = material(name)
    light = nodes("ShaderNodeEmission", Color=color, Strength=strength)
    nodes("ShaderNodeOutputMaterial", Surface=light.outputs[0])
    return made
