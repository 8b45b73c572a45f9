#!/usr/bin/env python3
"""Counts the instructions of ways to show light, as a compiler for real GPUs makes them.

    instructions.py [GPU ...]        GPUs as Mesa names them: navi21 (the default), polaris10, vega10 ...

Compiles the functions of shaders/ and plain shaders to compare with by Mesa's driver for AMD GPUs, which needs no GPU for
that (RADV_FORCE_FAMILY), and prints a table in Markdown. Needs glslangValidator, mesa-vulkan-drivers, and the Python package
vulkan.
"""

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


def spirv(source, stage):
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, f"shader.{stage}")
        path.write_text(source)
        made = Path(folder, "shader.spv")
        run = subprocess.run(["glslangValidator", "-V", str(path), "-o", str(made)], capture_output=True, text=True)
        if run.returncode != 0:
            raise SystemExit(f"glslangValidator: {run.stdout}")
        return made.read_bytes()


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
        kinds = [vk.VK_DESCRIPTOR_TYPE_UNIFORM_BUFFER, vk.VK_DESCRIPTOR_TYPE_COMBINED_IMAGE_SAMPLER]
        bindings = [
            vk.VkDescriptorSetLayoutBinding(
                binding=i, descriptorType=kind, descriptorCount=1, stageFlags=vk.VK_SHADER_STAGE_ALL_GRAPHICS
            )
            for i, kind in enumerate(kinds)
        ]
        sets = vk.vkCreateDescriptorSetLayout(
            self.device, vk.VkDescriptorSetLayoutCreateInfo(pBindings=bindings), None
        )
        camera = vk.VkPushConstantRange(stageFlags=vk.VK_SHADER_STAGE_VERTEX_BIT, offset=0, size=64)
        self.layout = vk.vkCreatePipelineLayout(
            self.device, vk.VkPipelineLayoutCreateInfo(pSetLayouts=[sets], pPushConstantRanges=[camera]), None
        )

    def assembly(self, vertex, fragment):
        """Machine code as text, of both stages."""
        vk = self.vk
        stages = []
        for source, stage, bit in [
            (vertex, "vert", vk.VK_SHADER_STAGE_VERTEX_BIT),
            (fragment, "frag", vk.VK_SHADER_STAGE_FRAGMENT_BIT),
        ]:
            code = spirv(source, stage)
            module = vk.vkCreateShaderModule(
                self.device, vk.VkShaderModuleCreateInfo(codeSize=len(code), pCode=code), None
            )
            stages.append(vk.VkPipelineShaderStageCreateInfo(stage=bit, module=module, pName="main"))
        inputs = {"uvec2 a_lightuv": vk.VK_FORMAT_R16G16_UINT, "float a_light;": vk.VK_FORMAT_R16_UNORM}
        light = next((kind for name, kind in inputs.items() if name in vertex), vk.VK_FORMAT_R16G16_UNORM)
        formats = [vk.VK_FORMAT_R32G32B32_SFLOAT, light]
        vertex_input = vk.VkPipelineVertexInputStateCreateInfo(
            pVertexBindingDescriptions=[
                vk.VkVertexInputBindingDescription(binding=i, stride=[12, 4][i], inputRate=vk.VK_VERTEX_INPUT_RATE_VERTEX)
                for i in (0, 1)
            ],
            pVertexAttributeDescriptions=[
                vk.VkVertexInputAttributeDescription(location=i, binding=i, format=formats[i], offset=0) for i in (0, 1)
            ],
        )
        blend = vk.VkPipelineColorBlendAttachmentState(blendEnable=vk.VK_FALSE, colorWriteMask=15)
        information = vk.VkGraphicsPipelineCreateInfo(
            flags=vk.VK_PIPELINE_CREATE_CAPTURE_INTERNAL_REPRESENTATIONS_BIT_KHR,
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
        return [self._code(pipeline, number) for number in (0, 1)]

    def _code(self, pipeline, number):
        vk = self.vk
        # The package's own wrapper asks for sizes and never for the texts.
        from vulkan._vulkan import ffi, lib

        name = "vkGetPipelineExecutableInternalRepresentationsKHR"
        ask = ffi.cast(f"PFN_{name}", lib.vkGetDeviceProcAddr(self.device, name.encode()))
        which = ffi.new("VkPipelineExecutableInfoKHR*")
        which.sType = vk.VK_STRUCTURE_TYPE_PIPELINE_EXECUTABLE_INFO_KHR
        which.pipeline, which.executableIndex = pipeline, number
        count = ffi.new("uint32_t*")
        ask(self.device, which, count, ffi.NULL)
        found = ffi.new("VkPipelineExecutableInternalRepresentationKHR[]", count[0])
        for representation in found:
            representation.sType = vk.VK_STRUCTURE_TYPE_PIPELINE_EXECUTABLE_INTERNAL_REPRESENTATION_KHR
        ask(self.device, which, count, found)
        texts = [ffi.new("char[]", representation.dataSize) for representation in found]
        for representation, text in zip(found, texts):
            representation.pData = text
        ask(self.device, which, count, found)
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


def main():
    for family in sys.argv[1:] or ["navi21"]:
        if os.environ.get("RADV_FORCE_FAMILY") != family:
            drivers = next(Path("/usr/share/vulkan/icd.d").glob("radeon_icd*.json"), None)
            if drivers is None:
                raise SystemExit("no Vulkan driver for AMD GPUs: apt-get install mesa-vulkan-drivers")
            env = {"RADV_FORCE_FAMILY": family, "VK_DRIVER_FILES": drivers, "VK_ICD_FILENAMES": drivers}
            subprocess.run([sys.executable, __file__, family], env={**os.environ, **env}, check=True)
            continue
        compiler = Compiler()
        print(f"{compiler.name}\n")
        print("| way | vertex: vector | scalar | fragment: vector | varyings | fetches | scalar |")
        print("|---|---:|---:|---:|---:|---:|---:|")
        for name, (vertex, fragment) in WAYS.items():
            v, f = (counted(code) for code in compiler.assembly(vertex, fragment))
            cells = [v["vector"], v["scalar"], f["vector"], f["varyings"], f["fetches"], f["scalar"]]
            print(f"| {name} | {' | '.join(str(cell) for cell in cells)} |")
        print()


if __name__ == "__main__":
    main()
