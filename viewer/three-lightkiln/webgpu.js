// The eta-blend in TSL, for WebGPURenderer (with WebGPU or WebGL 2): node materials in the place of patched ones.
//
//   loader.register((parser) => new LightkilnPlugin(parser, { nodes: lightkilnNodes }))

import {
  BasicLightMapNode, IrradianceNode, MeshBasicNodeMaterial, MeshPhysicalNodeMaterial, MeshStandardNodeMaterial,
} from 'three/webgpu'
import {
  Fn, If, attribute, clamp, float, floor, int, ivec2, materialAO, mix, normalWorld, pow, reference, select, sign, texture,
  textureLoad, uint, uniform, uvec2, varying, vec2, vec3, vec4,
} from 'three/tsl'
import {
  COLOR_FLAG, COLOR_STEPS, CURVE_BASE, CURVE_KNEE, ETA_EPSILON, INTEROP_COLOR, RGB_SHIFTS, RGB_STEPS, SH_AXIS,
  SH_CONSTANT, SH_DIFFERENCE, SH_LINEAR, SH_PRODUCT, SUBTEXELS, TABLE_WIDTH, attributeName, harmonic,
} from 'lightkiln-format'

const CLASSES = {
  MeshBasicMaterial: MeshBasicNodeMaterial,
  MeshStandardMaterial: MeshStandardNodeMaterial,
  MeshPhysicalMaterial: MeshPhysicalNodeMaterial,
}

/** A layer as a node: three numbers as stored in 0..1, gray for scalar layers. */
export function storedLight(layer) {
  const { isColor, texel: at, color: own } = layer.stack ? pairOf(layer) : codeOf(layer)
  const color = varying(select(isColor, own, vec3(0)))
  if (layer.atlas === null) return color
  const { width, height, depth } = layer.atlas.image
  const place = varying(select(isColor, vec3(0), vec3(at.div(vec2(width, height)), 1)))
  return Fn(() => {
    const unit = color.toVar()
    If(place.z.greaterThan(ETA_EPSILON), () => {
      const uv = place.xy.div(place.z).toVar()
      // The level is given: the lookup stands inside of a branch, which WGSL does not let derivatives into.
      const texel = layer.pages.length === 1 ? texture(layer.atlas, uv).level(0) : ofPages(layer.atlas, uv, depth)
      unit.addAssign((layer.channels === 1 ? texel.rrr : texel.rgb).mul(place.z))
    })
    return unit
  })()
}

function ofPages(atlas, uv, count) {
  const page = clamp(floor(uv.y), 0, count - 1).toVar()
  return texture(atlas, vec2(uv.x, uv.y.sub(page))).depth(int(page)).level(0)
}

/** What a vertex stores, as an integer code. */
function codeOf(layer) {
  const code = attribute(attributeName(layer), 'uvec2')
  return { isColor: code.y.greaterThanEqual(uint(COLOR_FLAG)), texel: vec2(code).div(SUBTEXELS), color: colorOf(layer, code) }
}

/** The same in the profile texcoord: a pair of floats. */
function pairOf(layer) {
  const pair = attribute(attributeName(layer), 'vec2')
  const isColor = pair.y.greaterThanEqual(INTEROP_COLOR)
  // What is no color must not become an integer.
  const bits = select(isColor, vec2(pair.x, pair.y.sub(INTEROP_COLOR)), vec2(0))
  const code = uvec2(uint(bits.x), uint(bits.y).add(uint(COLOR_FLAG)))
  return { isColor, texel: pair.mul(vec2(...layer.stack)), color: layer.form === 'scalar' ? vec3(pair.x) : colorOf(layer, code) }
}

function colorOf({ form, channels, palette }, code) {
  if (form === 'scalar') return vec3(float(code.x).div(COLOR_STEPS))
  const bits = code.y.sub(uint(COLOR_FLAG)).shiftLeft(uint(16)).bitOr(code.x)
  if (form === 'rgb') {
    return vec3(...RGB_SHIFTS.map((shift, c) =>
      float(bits.shiftRight(uint(shift)).bitAnd(uint(RGB_STEPS[c]))).div(RGB_STEPS[c])))
  }
  const entry = textureLoad(palette, ivec2(int(bits.bitAnd(uint(TABLE_WIDTH - 1))), int(bits.div(uint(TABLE_WIDTH)))))
  return channels === 1 ? entry.rrr : entry.rgb
}

/** A layer as a node, in the signal's unit. */
export function light(layer) {
  const { low, extent, white } = layer.scale
  const p = storedLight(layer).mul(extent).add(low)
  if (white <= 0) return clampedLight(layer, p)
  return clampedLight(layer, sign(p).mul(pow(vec3(CURVE_BASE), p.abs()).sub(1)).mul(white / CURVE_KNEE))
}

/** After interpolation, in layers that ask for it (Kavan et al. 2011, section 3.3). */
const clampedLight = ({ clamp: ends }, value) =>
  (ends === null || ends === undefined ? value : clamp(value, vec3(ends[0]), vec3(ends[1])))

/** What a view shows: a layer as stored, or the share of its clamp. */
function viewedLight(layer) {
  if (layer.clamp === null || layer.clamp === undefined) return storedLight(layer)
  const [low, high] = layer.clamp
  return light(layer).sub(low).div(high - low)
}

/** Irradiance for the normal of the pixel, which is turned back into the world of the file. */
function harmonicIrradiance(layers, owner) {
  const fromWorld = uniform(owner.updateFromWorld()).onRenderUpdate(() => owner.updateFromWorld())
  const n = fromWorld.mul(normalWorld).normalize().toVar()
  const basis = [
    float(SH_CONSTANT), n.y.mul(SH_LINEAR), n.z.mul(SH_LINEAR), n.x.mul(SH_LINEAR),
    n.x.mul(n.y).mul(SH_PRODUCT), n.y.mul(n.z).mul(SH_PRODUCT), n.z.mul(n.z).mul(3).sub(1).mul(SH_AXIS),
    n.x.mul(n.z).mul(SH_PRODUCT), n.x.mul(n.x).sub(n.y.mul(n.y)).mul(SH_DIFFERENCE),
  ]
  return layers.reduce((sum, layer) => sum.add(light(layer).mul(basis[harmonic(layer)])), vec3(0))
}

/** What the plugin calls: gives meshes with light a node material. */
export const lightkilnNodes = {
  material(material, owner, layers, view) {
    const Class = CLASSES[material.type]
    if (Class === undefined) return material
    const copy = new Class()
    const own = ['type', 'uuid', 'onBeforeCompile', 'customProgramCacheKey']
    for (const key of Object.keys(material)) if (!own.includes(key)) copy[key] = material[key]
    const sum = (role) => layers.filter((layer) => layer.role === role).map(light)
    const occlusions = sum('occlusion')
    const irradiances = sum('irradiance')
    const harmonics = layers.filter(({ role }) => role === 'harmonics')
    if (harmonics.length > 0 && Class !== MeshBasicNodeMaterial) irradiances.push(harmonicIrradiance(harmonics, owner))
    const occlusion = occlusions.reduce((product, node) =>
      product.mul(mix(1, node.r, reference('occlusionIntensity', 'float', owner))), float(1))
    if (occlusions.length > 0) copy.aoNode = material.aoMap ? materialAO.mul(occlusion) : occlusion
    if (irradiances.length > 0) {
      const irradiance = irradiances.reduce((total, node) => total.add(node), vec3(0))
        .max(0).mul(reference('irradianceIntensity', 'float', owner))
      // Deviation: three dims all indirect light by the occlusion; ours must not dim baked light, so it is undone here.
      const undimmed = irradiance.div(occlusion.max(1e-3))
      const LightMapNode = Class === MeshBasicNodeMaterial ? BasicLightMapNode : IrradianceNode
      copy.setupLightMap = () => new LightMapNode(undimmed)
    }
    if (view !== null) copy.fragmentNode = vec4(viewedLight(view), 1)
    return copy
  },
}
