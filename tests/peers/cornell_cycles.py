"""Irradiance at given points of a scene by Blender's path tracer Cycles, for comparison with our own.

    python cornell_cycles.py SCENE.glb POINTS.json [--samples N] [--runs N] > cycles.json

Needs the module `bpy` (PyPI). POINTS.json is what the example `irradiance_points` of crates/bake prints. The scene's
triangles are read from the file itself and not by Blender's importer, so that materials are exactly diffuse: linear
base color, emission in cd/m2. Over every point lies a probe, a triangle of a tenth of a millimetre, whose one texel is
baked: diffuse light without color, which is irradiance / pi. Probes hide nothing that could be measured.

Runs differ in their seed. Their mean is the answer, and their spread says how noisy it is.
"""

import argparse
import json
import math
import os
import struct
import sys
import time

import bpy
import numpy as np

PROBE_SIDE = 1e-4
PROBE_HEIGHT = 2e-5
BOUNCES = 64


def read_glb(path):
    """The JSON and the binary chunk of a .glb file."""
    data = open(path, "rb").read()
    length = struct.unpack_from("<I", data, 12)[0]
    return json.loads(data[20 : 20 + length]), data[28 + length :]


def accessor(document, binary, index):
    """An accessor without sparse values or strides, as our own scenes have them."""
    item = document["accessors"][index]
    view = document["bufferViews"][item["bufferView"]]
    kind = {5123: "<u2", 5125: "<u4", 5126: "<f4"}[item["componentType"]]
    width = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}[item["type"]]
    start = view.get("byteOffset", 0) + item.get("byteOffset", 0)
    values = np.frombuffer(binary, kind, item["count"] * width, start)
    return values.reshape(-1, width) if width > 1 else values


def local_matrix(node):
    """Of a node with translation, rotation and scale."""
    x, y, z, w = node.get("rotation", [0, 0, 0, 1])
    turn = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )
    matrix = np.eye(4)
    matrix[:3, :3] = turn * np.array(node.get("scale", [1, 1, 1]))
    matrix[:3, 3] = node.get("translation", [0, 0, 0])
    return matrix


def diffuse(name, color, emission=(0, 0, 0)):
    """A material of a diffuse reflection and an emission, both linear."""
    material = bpy.data.materials.new(name)
    material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    reflect = nodes.new("ShaderNodeBsdfDiffuse")
    reflect.inputs["Color"].default_value = [*color, 1]
    surface = reflect.outputs[0]
    if max(emission) > 0:
        glow, add = nodes.new("ShaderNodeEmission"), nodes.new("ShaderNodeAddShader")
        strength = max(emission)
        glow.inputs["Color"].default_value = [*(e / strength for e in emission), 1]
        glow.inputs["Strength"].default_value = strength
        links.new(surface, add.inputs[0])
        links.new(glow.outputs[0], add.inputs[1])
        surface = add.outputs[0]
    links.new(surface, nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    return material


def add_object(name, vertices, triangles, material):
    mesh = bpy.data.meshes.new(name)
    mesh.from_pydata(np.asarray(vertices, float).tolist(), [], np.asarray(triangles, int).tolist())
    mesh.materials.append(material)
    thing = bpy.data.objects.new(name, mesh)
    bpy.context.scene.collection.objects.link(thing)
    return thing


def add_scene(path):
    """All triangles of the default scene, with their materials."""
    document, binary = read_glb(path)
    materials = []
    for item in document["materials"]:
        strength = item.get("extensions", {}).get("KHR_materials_emissive_strength", {}).get("emissiveStrength", 1)
        emission = [e * strength for e in item.get("emissiveFactor", [0, 0, 0])]
        materials.append(diffuse(item["name"], item["pbrMetallicRoughness"]["baseColorFactor"][:3], emission))

    def visit(index, above):
        node = document["nodes"][index]
        matrix = above @ local_matrix(node)
        if "mesh" in node:
            for primitive in document["meshes"][node["mesh"]]["primitives"]:
                points = accessor(document, binary, primitive["attributes"]["POSITION"])
                points = points @ matrix[:3, :3].T + matrix[:3, 3]
                triangles = accessor(document, binary, primitive["indices"]).reshape(-1, 3)
                add_object(node["name"], points, triangles, materials[primitive["material"]])
        for child in node.get("children", []):
            visit(child, matrix)

    for root in document["scenes"][document.get("scene", 0)]["nodes"]:
        visit(root, np.eye(4))


def add_probes(points, side):
    """One triangle a point, each on a texel of its own of an image `side` texels wide."""
    corners = np.array([[0.1, 0.1], [0.9, 0.1], [0.5, 0.9]])
    vertices, uvs = [], []
    for number, point in enumerate(points):
        normal = np.array(point["normal"]) / np.linalg.norm(point["normal"])
        right = np.cross(normal, np.eye(3)[np.argmin(np.abs(normal))])
        right /= np.linalg.norm(right)
        up = np.cross(normal, right)
        centre = np.array(point["position"]) + PROBE_HEIGHT * normal
        texel = np.array([number % side, number // side])
        for corner in corners:
            offset = (corner - 0.5) * PROBE_SIDE
            vertices.append(centre + offset[0] * right + offset[1] * up)
            uvs.append((texel + corner) / side)
    probes = add_object(
        "probes", vertices, np.arange(len(vertices)).reshape(-1, 3), diffuse("probe", [0.8, 0.8, 0.8])
    )
    layer = probes.data.uv_layers.new(name="texels")
    layer.data.foreach_set("uv", np.array(uvs, np.float32).ravel())
    return probes


def main():
    arguments = argparse.ArgumentParser()
    arguments.add_argument("scene")
    arguments.add_argument("points")
    arguments.add_argument("--samples", type=int, default=4096)
    arguments.add_argument("--runs", type=int, default=8)
    arguments = arguments.parse_args()
    points = json.load(open(arguments.points))["points"]
    side = math.ceil(math.sqrt(len(points)))

    # Blender reports on standard output, which is ours: it goes to standard error until the end.
    output = os.dup(1)
    os.dup2(2, 1)

    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    cycles = scene.cycles
    cycles.device = "CPU"
    cycles.samples = arguments.samples
    cycles.use_adaptive_sampling = False
    cycles.use_denoising = False
    cycles.max_bounces = cycles.diffuse_bounces = BOUNCES
    cycles.sample_clamp_direct = cycles.sample_clamp_indirect = 0
    cycles.light_sampling_threshold = 0
    cycles.use_fast_gi = False
    world = bpy.data.worlds.new("black")
    world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0
    scene.world = world

    add_scene(arguments.scene)
    probes = add_probes(points, side)
    image = bpy.data.images.new("probes", side, side, float_buffer=True)
    image.colorspace_settings.name = "Non-Color"
    nodes = probes.data.materials[0].node_tree.nodes
    target = nodes.new("ShaderNodeTexImage")
    target.image = image
    nodes.active = target
    bpy.context.view_layer.objects.active = probes
    probes.select_set(True)

    def bake(which):
        bpy.ops.object.bake(type="DIFFUSE", pass_filter=which, margin=0, use_clear=True, target="IMAGE_TEXTURES")
        pixels = np.empty(side * side * 4, np.float32)
        image.pixels.foreach_get(pixels)
        return np.pi * pixels.reshape(-1, 4)[: len(points), :3].astype(float)

    start, direct, both = time.time(), [], []
    for seed in range(arguments.runs):
        cycles.seed = seed
        direct.append(bake({"DIRECT"}))
        both.append(bake({"DIRECT", "INDIRECT"}))
        print(f"run {seed + 1} of {arguments.runs}, {time.time() - start:.0f} s", file=sys.stderr)

    def summary(runs):
        error = np.std(runs, axis=0, ddof=1) / math.sqrt(len(runs)) if len(runs) > 1 else np.zeros_like(runs[0])
        return np.mean(runs, axis=0).tolist(), error.tolist()

    (direct, direct_error), (both, both_error) = summary(direct), summary(both)
    answer = {
        "by": f"Cycles {bpy.app.version_string}",
        "seconds": time.time() - start,
        "samples": arguments.samples * arguments.runs,
        "points": [
            {**{k: p[k] for k in ("position", "normal")}, "direct": d, "directError": de, "irradiance": b, "irradianceError": be}
            for p, d, de, b, be in zip(points, direct, direct_error, both, both_error)
        ],
    }
    sys.stdout.flush()
    os.write(output, (json.dumps(answer) + "\n").encode())


main()
