#!/usr/bin/env python3
"""Counts the instructions of ways to show light, as a compiler for real GPUs makes them.

    instructions.py [--programs DIR] [GPU ...]        GPUs as Mesa names them: navi21 (the default), polaris10, vega10 ...

Compiles the functions of shaders/ and plain shaders to compare with by Mesa's driver for AMD GPUs, which needs no GPU for
that (RADV_FORCE_FAMILY), and prints a table in Markdown; of the programs that viewer/scenes/programs.mjs wrote into DIR another
one, with the cycles that the compiler's model of the GPU reckons with. Needs glslangValidator, mesa-vulkan-drivers, and the Python
package vulkan.
"""

import argparse
import os
import subprocess
import sys
import tempfile
from collections import Counter
from pathlib import Path

SHADERS = Path(__file__).resolve().parents[2] / "shaders"
OURS = {stage: (SHADERS / f"lightkiln.{stage}.glsl").read_text() for stage in ("vert", "frag")}

# A draw of a scene: a matrix and a position; what follows is what light adds.
VERTEX = """#version 450
{functions}
layout(push_constant) uniform Camera {{ mat4 clip_from_object; }};
layout(location = 0) in vec3 a_position;
{declarations}
void main() {{
    {statements}
    gl_Position = clip_from_object * vec4(a_position, 1.0);
}}
"""
FRAGMENT = """#version 450
{functions}
layout(set = 0, binding = 0) uniform Layer {{ vec3 scale; }};
layout(location = 0) out vec4 o_color;
{declarations}
void main() {{
    o_color = vec4({light}, 1.0);
}}
"""
PLAIN = (
    "layout(location = 1) in vec2 a_uv;\nlayout(location = 0) out vec2 v_uv;",
    "v_uv = a_uv;",
)


def hybrid(channels, *macros):
    kind, name = ("float", "Scalar") if channels == 1 else ("vec3", "Rgb")
    unscale = "lightkilnLightUnscale" + ("" if channels == 1 else "Rgb")
    varyings = f"layout(location = 0) {{0}} vec3 v_place;\nlayout(location = 1) {{0}} {kind} v_color;\n"
    functions = "".join(f"#define LIGHTKILN_{macro}\n" for macro in macros) + OURS["frag"]
    return (
        VERTEX.format(
            functions=OURS["vert"],
            declarations=varyings.format("out") + "layout(location = 1) in uvec2 a_lightuv;\nlayout(set = 0, binding = 0) uniform Atlas { vec2 page; };",
            statements=f"vec2 code = vec2(a_lightuv); v_place = lightkilnVertexPlace(code, page); v_color = lightkilnVertex{name}(code);",
        ),
        FRAGMENT.format(
            functions=functions,
            declarations=varyings.format("in") + "layout(set = 0, binding = 1) uniform LIGHTKILN_ATLAS u_atlas;",
            light=f"vec3({unscale}(lightkilnLight{name}(u_atlas, v_color, v_place), scale))",
        ),
    )


def lightmap(channels):
    unscale = "lightkilnLightUnscale" + ("" if channels == 1 else "Rgb")
    return (
        VERTEX.format(functions="", declarations=PLAIN[0], statements=PLAIN[1]),
        FRAGMENT.format(
            functions=OURS["frag"],
            declarations="layout(location = 0) in vec2 v_uv;\nlayout(set = 0, binding = 1) uniform sampler2D u_lightmap;",
            light=f"vec3({unscale}(texture(u_lightmap, v_uv).{'r' if channels == 1 else 'rgb'}, scale))",
        ),
    )


def vertices():
    return (
        VERTEX.format(
            functions="",
            declarations="layout(location = 1) in float a_light;\nlayout(location = 0) out float v_light;",
            statements="v_light = a_light;",
        ),
        FRAGMENT.format(
            functions=OURS["frag"],
            declarations="layout(location = 0) in float v_light;",
            light="vec3(lightkilnLightUnscale(v_light, scale))",
        ),
    )


WAYS = {
    "vertices, 1 channel": vertices(),
    "lightmap, 1 channel": lightmap(1),
    "hybrid, 1 channel": hybrid(1, "ONE_LEVEL", "ONE_PAGE"),
    "hybrid, many pages, 1 channel": hybrid(1, "ONE_LEVEL"),
    "hybrid with mip levels, 1 channel": hybrid(1, "ONE_PAGE"),
    "lightmap, RGB": lightmap(3),
    "hybrid, RGB": hybrid(3, "ONE_LEVEL", "ONE_PAGE"),
    "hybrid, many pages, RGB": hybrid(3, "ONE_LEVEL"),
    "hybrid with mip levels, RGB": hybrid(3, "ONE_PAGE"),
}


# Where the samplers of programs for WebGL are bound, which do not say; their other uniforms become one block at 0.
FIRST_SAMPLER, SAMPLERS = 16, 16


def spirv(vertex, fragment):
    """Both stages as SPIR-V. What they leave open is laid out for both alike: locations, bindings, uniforms outside of blocks."""
    with tempfile.TemporaryDirectory() as folder:
        for stage, source in (("vert", vertex), ("frag", fragment)):
            Path(folder, f"shader.{stage}").write_text(source)
        layout = ["-R", "--aml", "--amb", "--stb", str(FIRST_SAMPLER)]
        run = subprocess.run(
            ["glslangValidator", "-V", "-l", *layout, "shader.vert", "shader.frag"], cwd=folder, capture_output=True, text=True
        )
        if run.returncode != 0:
            raise SystemExit(f"glslangValidator: {run.stdout}")
        return [Path(folder, f"{stage}.spv").read_bytes() for stage in ("vert", "frag")]


def for_vulkan(source):
    """A shader for WebGL in the dialect that the compiler for Vulkan takes."""
    return source.replace("#version 300 es", "#version 450", 1)


class Compiler:
    """A device that compiles and cannot draw."""

    def __init__(self):
        import vulkan as vk

        self.vk = vk
        application = vk.VkApplicationInfo(apiVersion=vk.VK_MAKE_VERSION(1, 2, 0))
        self.instance = vk.vkCreateInstance(vk.VkInstanceCreateInfo(pApplicationInfo=application), None)
        [gpu, *_] = vk.vkEnumeratePhysicalDevices(self.instance)
        self.name = vk.vkGetPhysicalDeviceProperties(gpu).deviceName
        wanted = vk.VkPhysicalDevicePipelineExecutablePropertiesFeaturesKHR(pipelineExecutableInfo=vk.VK_TRUE)
        queue = vk.VkDeviceQueueCreateInfo(queueFamilyIndex=0, queueCount=1, pQueuePriorities=[1.0])
        self.device = vk.vkCreateDevice(
            gpu,
            vk.VkDeviceCreateInfo(
                pNext=wanted,
                pQueueCreateInfos=[queue],
                ppEnabledExtensionNames=["VK_KHR_pipeline_executable_properties"],
            ),
            None,
        )
        color = vk.VkAttachmentDescription(
            format=vk.VK_FORMAT_R8G8B8A8_UNORM,
            samples=vk.VK_SAMPLE_COUNT_1_BIT,
            loadOp=vk.VK_ATTACHMENT_LOAD_OP_CLEAR,
            storeOp=vk.VK_ATTACHMENT_STORE_OP_STORE,
            initialLayout=vk.VK_IMAGE_LAYOUT_UNDEFINED,
            finalLayout=vk.VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL,
        )
        reference = vk.VkAttachmentReference(attachment=0, layout=vk.VK_IMAGE_LAYOUT_COLOR_ATTACHMENT_OPTIMAL)
        subpass = vk.VkSubpassDescription(
            pipelineBindPoint=vk.VK_PIPELINE_BIND_POINT_GRAPHICS, pColorAttachments=[reference]
        )
        self.render_pass = vk.vkCreateRenderPass(
            self.device, vk.VkRenderPassCreateInfo(pAttachments=[color], pSubpasses=[subpass]), None
        )
        numbers = [0, 1, *range(FIRST_SAMPLER, FIRST_SAMPLER + SAMPLERS)]
        kinds = [vk.VK_DESCRIPTOR_TYPE_UNIFORM_BUFFER] + [vk.VK_DESCRIPTOR_TYPE_COMBINED_IMAGE_SAMPLER] * (1 + SAMPLERS)
        bindings = [
            vk.VkDescriptorSetLayoutBinding(
                binding=i, descriptorType=kind, descriptorCount=1, stageFlags=vk.VK_SHADER_STAGE_ALL_GRAPHICS
            )
            for i, kind in zip(numbers, kinds)
        ]
        sets = vk.vkCreateDescriptorSetLayout(
            self.device, vk.VkDescriptorSetLayoutCreateInfo(pBindings=bindings), None
        )
        camera = vk.VkPushConstantRange(stageFlags=vk.VK_SHADER_STAGE_VERTEX_BIT, offset=0, size=64)
        self.layout = vk.vkCreatePipelineLayout(
            self.device, vk.VkPipelineLayoutCreateInfo(pSetLayouts=[sets], pPushConstantRanges=[camera]), None
        )

    def compiled(self, vertex, fragment):
        """Of both stages, machine code as text and what the compiler says of it."""
        vk = self.vk
        stages = []
        bits = [vk.VK_SHADER_STAGE_VERTEX_BIT, vk.VK_SHADER_STAGE_FRAGMENT_BIT]
        for code, bit in zip(spirv(vertex, fragment), bits):
            module = vk.vkCreateShaderModule(
                self.device, vk.VkShaderModuleCreateInfo(codeSize=len(code), pCode=code), None
            )
            stages.append(vk.VkPipelineShaderStageCreateInfo(stage=bit, module=module, pName="main"))
        vectors = [vk.VK_FORMAT_R32G32B32_SFLOAT]
        inputs = {
            "uvec2 a_lightuv": [vk.VK_FORMAT_R16G16_UINT],
            "float a_light;": [vk.VK_FORMAT_R16_UNORM],
            # Materials: normal, texture coordinate, light.
            "vec2 _lightuv": [*vectors, vk.VK_FORMAT_R32G32_SFLOAT, vk.VK_FORMAT_R16G16_USCALED],
            "vec3 normal": [*vectors, vk.VK_FORMAT_R32G32_SFLOAT, vk.VK_FORMAT_R16G16_UNORM],
        }
        formats = vectors + next((kinds for name, kinds in inputs.items() if name in vertex), [vk.VK_FORMAT_R16G16_UNORM])
        vertex_input = vk.VkPipelineVertexInputStateCreateInfo(
            pVertexBindingDescriptions=[
                vk.VkVertexInputBindingDescription(binding=i, stride=16, inputRate=vk.VK_VERTEX_INPUT_RATE_VERTEX)
                for i in range(len(formats))
            ],
            pVertexAttributeDescriptions=[
                vk.VkVertexInputAttributeDescription(location=i, binding=i, format=kind, offset=0)
                for i, kind in enumerate(formats)
            ],
        )
        blend = vk.VkPipelineColorBlendAttachmentState(blendEnable=vk.VK_FALSE, colorWriteMask=15)
        information = vk.VkGraphicsPipelineCreateInfo(
            flags=vk.VK_PIPELINE_CREATE_CAPTURE_INTERNAL_REPRESENTATIONS_BIT_KHR
            | vk.VK_PIPELINE_CREATE_CAPTURE_STATISTICS_BIT_KHR,
            pStages=stages,
            pVertexInputState=vertex_input,
            pInputAssemblyState=vk.VkPipelineInputAssemblyStateCreateInfo(
                topology=vk.VK_PRIMITIVE_TOPOLOGY_TRIANGLE_LIST
            ),
            pViewportState=vk.VkPipelineViewportStateCreateInfo(
                pViewports=[vk.VkViewport(0, 0, 64, 64, 0, 1)],
                pScissors=[vk.VkRect2D(vk.VkOffset2D(0, 0), vk.VkExtent2D(64, 64))],
            ),
            pRasterizationState=vk.VkPipelineRasterizationStateCreateInfo(lineWidth=1.0),
            pMultisampleState=vk.VkPipelineMultisampleStateCreateInfo(rasterizationSamples=vk.VK_SAMPLE_COUNT_1_BIT),
            pColorBlendState=vk.VkPipelineColorBlendStateCreateInfo(pAttachments=[blend]),
            layout=self.layout,
            renderPass=self.render_pass,
        )
        [pipeline] = vk.vkCreateGraphicsPipelines(self.device, None, 1, [information], None)
        return [(self._code(pipeline, number), self._statistics(pipeline, number)) for number in (0, 1)]

    def _ask(self, pipeline, number, what):
        """What the driver knows of a stage, and the function and the question that it was asked by. The package's own wrapper asks
        for sizes and never for texts."""
        from vulkan._vulkan import ffi, lib

        name = f"vkGetPipelineExecutable{what}sKHR"
        ask = ffi.cast(f"PFN_{name}", lib.vkGetDeviceProcAddr(self.device, name.encode()))
        which = ffi.new("VkPipelineExecutableInfoKHR*")
        which.sType = self.vk.VK_STRUCTURE_TYPE_PIPELINE_EXECUTABLE_INFO_KHR
        which.pipeline, which.executableIndex = pipeline, number
        count = ffi.new("uint32_t*")
        ask(self.device, which, count, ffi.NULL)
        found = ffi.new(f"VkPipelineExecutable{what}KHR[]", count[0])
        kind = {"Statistic": "STATISTIC", "InternalRepresentation": "INTERNAL_REPRESENTATION"}[what]
        for answer in found:
            answer.sType = getattr(self.vk, f"VK_STRUCTURE_TYPE_PIPELINE_EXECUTABLE_{kind}_KHR")
        ask(self.device, which, count, found)
        return found, lambda: ask(self.device, which, count, found)

    def _statistics(self, pipeline, number):
        from vulkan._vulkan import ffi

        found, _ = self._ask(pipeline, number, "Statistic")
        return {ffi.string(statistic.name).decode(): statistic.value.u64 for statistic in found}

    def _code(self, pipeline, number):
        from vulkan._vulkan import ffi

        found, ask = self._ask(pipeline, number, "InternalRepresentation")
        texts = [ffi.new("char[]", representation.dataSize) for representation in found]
        for representation, text in zip(found, texts):
            representation.pData = text
        ask()
        for representation, text in zip(found, texts):
            if ffi.string(representation.name) == b"Assembly":
                return ffi.string(text).decode()
        raise SystemExit("the driver shows no assembly")


def counted(assembly):
    """Instructions by kind: vector arithmetic, interpolation of varyings, scalar ones, texture fetches."""
    kinds = Counter()
    for line in assembly.splitlines():
        word = line.split()[0] if line.split() else ""
        if word.startswith("v_interp"):
            kinds["varyings"] += 1
        elif word.startswith("image_"):
            kinds["fetches"] += 1
        elif word.startswith("v_"):
            kinds["vector"] += 1
        elif word.startswith("s_") and word not in ("s_nop", "s_code_end", "s_endpgm"):
            kinds["scalar"] += 1
    return kinds


def of_materials(folder):
    """The programs of a folder by name: source of both stages."""
    names = sorted(path.name.removesuffix(".vert.glsl") for path in Path(folder).glob("*.vert.glsl"))
    if not names:
        raise SystemExit(f"{folder} has no programs: node viewer/scenes/programs.mjs {folder}")
    names.sort(key=lambda name: (name != "nothing", name))
    return {name: [for_vulkan(Path(folder, f"{name}.{stage}.glsl").read_text()) for stage in ("vert", "frag")] for name in names}


def print_table(head, rows):
    print(f"| {' | '.join(head)} |")
    print("|---" + "|---:" * (len(head) - 1) + "|")
    for row in rows:
        print(f"| {' | '.join(str(cell) for cell in row)} |")
    print()


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--programs", metavar="DIR")
    parser.add_argument("families", metavar="GPU", nargs="*", default=["navi21"])
    arguments = parser.parse_args()
    programs = arguments.programs
    for family in arguments.families:
        if os.environ.get("RADV_FORCE_FAMILY") != family:
            drivers = next(Path("/usr/share/vulkan/icd.d").glob("radeon_icd*.json"), None)
            if drivers is None:
                raise SystemExit("no Vulkan driver for AMD GPUs: apt-get install mesa-vulkan-drivers")
            env = {"RADV_FORCE_FAMILY": family, "VK_DRIVER_FILES": drivers, "VK_ICD_FILENAMES": drivers}
            again = [family] if programs is None else ["--programs", programs, family]
            subprocess.run([sys.executable, __file__, *again], env={**os.environ, **env}, check=True)
            continue
        compiler = Compiler()
        print(f"{compiler.name}\n")
        rows = []
        for name, (vertex, fragment) in WAYS.items():
            v, f = (counted(code) for code, _ in compiler.compiled(vertex, fragment))
            rows.append([name, v["vector"], v["scalar"], f["vector"], f["varyings"], f["fetches"], f["scalar"]])
        print_table(["way", "vertex: vector", "scalar", "fragment: vector", "varyings", "fetches", "scalar"], rows)
        if programs is None:
            continue
        rows = []
        for name, (vertex, fragment) in of_materials(programs).items():
            (v, of_vertex), (f, of_fragment) = compiler.compiled(vertex, fragment)
            v, f = counted(v), counted(f)
            cycles = [statistics[kind] for statistics in (of_vertex, of_fragment) for kind in ("Inverse Throughput", "Latency")]
            rows.append([name, v["vector"], v["scalar"], *cycles[:2], f["vector"], f["varyings"], f["fetches"], f["scalar"], *cycles[2:]])
        head = ["way", "vertex: vector", "scalar", "cycles", "latency", "fragment: vector", "varyings", "fetches", "scalar", "cycles", "latency"]
        print_table(head, rows)


if __name__ == "__main__":
    main()
