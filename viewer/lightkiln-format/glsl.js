// The eta-blend as GLSL ES 3.00 for engines that write `attribute` and `varying` (three.js and Babylon.js translate them).
// Schaefer et al. 2012, section 4.3; its twin in plain JavaScript is decode.js.
//
// A layer here is one of `readExtension` with three more fields: `role`, and `atlas` and `palette`, which are null where the
// layer has no pages or no table. An atlas is a 2D texture where there is one page, else an array of them; without mip levels.

import {
  COLOR_FLAG, COLOR_STEPS, CURVE_BASE, CURVE_KNEE, ETA_EPSILON, INTEROP_COLOR, RGB_SHIFTS, RGB_STEPS, SH_AXIS, SH_CONSTANT, SH_DIFFERENCE,
  SH_LINEAR, SH_PRODUCT, SUBTEXELS, TABLE_WIDTH,
} from './constants.js'

const float = (x) => (Number.isInteger(x) ? `${x}.0` : `${x}`)
const bracketed = (x) => `(${float(x)})`
const isLogarithmic = ({ scale }) => scale.white > 0
const typeOf = ({ channels }) => (channels === 1 ? 'float' : 'vec3')

/** The attribute's name in shaders and geometries: three.js lower-cases names that it does not know. */
export const attributeName = ({ attribute }) => attribute.toLowerCase()

/** What tells the programs of two lights apart. */
export function shaderKey(layers, view) {
  const parts = layers.map((layer) =>
    [layer.index, attributeName(layer), layer.channels, layer.form, layer.role, isLogarithmic(layer) ? 1 : 0, Math.min(layer.pages.length, 2), layer.clamp ?? '', layer.stack ?? ''].join(','))
  return `lightkiln:${parts.join(';')}:${view?.index ?? ''}`
}

/** Declarations of the vertex stage. */
export function vertexDeclarations(layers) {
  const attributes = layers.map((layer) => `
attribute vec2 ${attributeName(layer)};
varying highp ${typeOf(layer)} vLightkilnColor${layer.index};
${layer.form === 'table' ? `uniform highp sampler2D lightkilnTable${layer.index};` : ''}`)
  return `
varying highp vec3 vLightkilnPlace; // UV in pages, and eta
uniform highp vec2 lightkilnPage; // width and height of a page, in texels
${attributes.join('')}
highp vec2 lightkilnInterop(vec2 pair, vec2 color, vec2 stack) {
  return pair.y >= ${float(INTEROP_COLOR)} ? color : pair * stack * ${float(SUBTEXELS)};
}
int lightkilnBits(vec2 code) {
  return ((int(code.y) - ${COLOR_FLAG}) << 16) | int(code.x);
}
highp float lightkilnScalar(vec2 code) {
  return code.x / ${float(COLOR_STEPS)};
}
highp vec3 lightkilnRgb(vec2 code) {
  ivec3 steps = ivec3(${RGB_STEPS.join(', ')});
  return vec3((ivec3(lightkilnBits(code)) >> ivec3(${RGB_SHIFTS.join(', ')})) & steps) / vec3(steps);
}
highp vec3 lightkilnEntry(highp sampler2D table, vec2 code) {
  int index = lightkilnBits(code);
  return texelFetch(table, ivec2(index % ${TABLE_WIDTH}, index / ${TABLE_WIDTH}), 0).rgb;
}`
}

/** Statements of the vertex stage. All layers of a file share the places of their texture-vertices: one serves them all. */
export function vertexMain(layers) {
  const code = (layer) => `lightkilnCode${layer.index}`
  const first = code(layers[0])
  const colors = layers.map((layer) => {
    const name = code(layer)
    const colorOf = {
      scalar: `lightkilnScalar(${name})`,
      rgb: `lightkilnRgb(${name})`,
      table: `lightkilnEntry(lightkilnTable${layer.index}, ${name})${layer.channels === 1 ? '.r' : ''}`,
    }
    // Arithmetic costs less than a branch around it; an entry is read where it is needed only.
    const zero = `${typeOf(layer)}(0.0)`
    return layer.form === 'table' ? `
  vLightkilnColor${layer.index} = ${zero};
  if (lightkilnIsColor) vLightkilnColor${layer.index} = ${colorOf[layer.form]};` : `
  highp ${typeOf(layer)} lightkilnColor${layer.index} = ${colorOf[layer.form]};
  vLightkilnColor${layer.index} = lightkilnIsColor ? lightkilnColor${layer.index} : ${zero};`
  })
  return `${layers.map((layer) => `
  vec2 ${code(layer)} = ${codeOf(layer)};`).join('')}
  bool lightkilnIsColor = ${first}.y >= ${float(COLOR_FLAG)};
  highp vec2 lightkilnPlace = ${first} / (${float(SUBTEXELS)} * lightkilnPage);
  vLightkilnPlace = lightkilnIsColor ? vec3(0.0) : vec3(lightkilnPlace, 1.0);
${colors.join('')}`
}

/** The code of a vertex; in the profile texcoord from a pair of floats (shaders/lightkiln.vert.glsl, `lightkilnVertexInterop`). */
function codeOf(layer) {
  const name = attributeName(layer)
  if (layer.stack === null || layer.stack === undefined) return name
  const color = layer.form === 'scalar' ? `vec2(${name}.x * ${float(COLOR_STEPS)}, ${float(COLOR_FLAG)})`
    : `vec2(${name}.x, ${name}.y - ${float(INTEROP_COLOR)} + ${float(COLOR_FLAG)})`
  return `lightkilnInterop(${name}, ${color}, vec2(${layer.stack.map(float).join(', ')}))`
}

/** Declarations of the fragment stage. */
export function fragmentDeclarations(layers) {
  const uniforms = layers.map(({ index, pages, ...layer }) => `
varying highp ${typeOf(layer)} vLightkilnColor${index};
uniform highp vec3 lightkilnScale${index}; // P(low), P(high) - P(low), white or 0
${pages.length === 0 ? '' : `uniform highp sampler2D${pages.length === 1 ? '' : 'Array'} lightkilnAtlas${index};`}`)
  return `
varying highp vec3 vLightkilnPlace;
uniform float lightkilnOcclusionIntensity;
uniform float lightkilnIrradianceIntensity;
uniform float lightkilnShadowIntensity;
${uniforms.join('')}
// The lookups stand inside of a branch, where derivatives are undefined: nothing depends on them, for there is one mip level
// and no anisotropy.
highp vec3 lightkilnLookup(highp sampler2DArray atlas) {
  highp vec2 uv = vLightkilnPlace.xy / vLightkilnPlace.z;
  highp float page = clamp(floor(uv.y), 0.0, float(textureSize(atlas, 0).z - 1));
  return texture(atlas, vec3(uv.x, uv.y - page, page)).rgb;
}
highp vec3 lightkilnLookupPage(highp sampler2D atlas) {
  return texture(atlas, vLightkilnPlace.xy / vLightkilnPlace.z).rgb;
}
${['float', 'vec3'].map((type) => `
highp ${type} lightkilnUndo(highp ${type} unit, highp vec3 scale) {
  highp ${type} p = scale.x + unit * scale.y;
  return sign(p) * (pow(${type}(${float(CURVE_BASE)}), abs(p)) - 1.0) * (scale.z / ${float(CURVE_KNEE)});
}`).join('')}`
}

/** Statements of the fragment stage, as two parts: see these. */
export function fragmentMain(layers) {
  return `${fragmentTexels(layers)}${fragmentLight(layers)}`
}

/**
 * Its first part: asks for the texels, `lightkilnTexel<k>`. A GPU goes on until somebody uses them, so the more stands between the two
 * parts, the less it waits.
 */
export function fragmentTexels(layers) {
  const textured = layers.filter(({ pages }) => pages.length > 0)
  if (textured.length === 0) return ''
  const texel = ({ index }) => `lightkilnTexel${index}`
  return `
${textured.map((layer) => `  highp ${typeOf(layer)} ${texel(layer)} = ${typeOf(layer)}(0.0);`).join('\n')}
  if (vLightkilnPlace.z > ${float(ETA_EPSILON)}) {
${textured.map((layer) => {
    const lookup = `lightkilnLookup${layer.pages.length === 1 ? 'Page' : ''}(lightkilnAtlas${layer.index})`
    return `    ${texel(layer)} = ${lookup}${layer.channels === 1 ? '.r' : ''};`
  }).join('\n')}
  }`
}

/**
 * Its second part: `lightkilnUnit<k>` is a layer as stored (the share of its `clamp`, if it has one),
 * `lightkiln<k>` in the signal's unit, both gray for scalar layers; `lightkilnOcclusion`, `lightkilnShadow` and `lightkilnIrradiance` are what the roles make of them.
 */
export function fragmentLight(layers) {
  const values = layers.map((layer) => {
    const { index, pages, clamp } = layer
    const [stored, scale] = [`lightkilnStored${index}`, `lightkilnScale${index}`]
    const light = isLogarithmic(layer) ? `lightkilnUndo(${stored}, ${scale})` : `${scale}.x + ${stored} * ${scale}.y`
    return `
  highp ${typeOf(layer)} ${stored} = vLightkilnColor${index}${pages.length === 0 ? '' : ` + vLightkilnPlace.z * lightkilnTexel${index}`};
  highp vec3 lightkilnUnit${index} = vec3(${stored});
  highp vec3 lightkiln${index} = vec3(${light});${clampStatements(index, clamp)}`
  })
  const factor = (layer, intensity) => `mix(1.0, lightkiln${layer.index}.r, ${intensity})`
  const sums = layers.map((layer) => {
    if (layer.role === 'occlusion') return `  lightkilnOcclusion *= ${factor(layer, 'lightkilnOcclusionIntensity')};`
    if (layer.role === 'shadow') return `  lightkilnShadow *= ${factor(layer, 'lightkilnShadowIntensity')};`
    if (layer.role === 'irradiance') {
      return `  lightkilnIrradiance += max(lightkiln${layer.index}, 0.0) * lightkilnIrradianceIntensity;`
    }
    return ''
  })
  return `
  float lightkilnOcclusion = 1.0;
  float lightkilnShadow = 1.0;
  vec3 lightkilnIrradiance = vec3(0.0);
${values.join('')}
${sums.join('\n')}`
}

/** After interpolation, in layers that ask for it (Kavan et al. 2011, section 3.3). */
function clampStatements(index, clamp) {
  if (clamp === null || clamp === undefined) return ''
  const [low, high] = clamp
  return `
  lightkiln${index} = clamp(lightkiln${index}, ${float(low)}, ${float(high)});
  lightkilnUnit${index} = (lightkiln${index} - ${bracketed(low)}) / ${bracketed(high - low)};`
}

/** The basis of `irradianceSh0` to `8` at the normal `n`. */
const HARMONICS = [
  `${SH_CONSTANT}`,
  `${SH_LINEAR} * n.y`, `${SH_LINEAR} * n.z`, `${SH_LINEAR} * n.x`,
  `${SH_PRODUCT} * n.x * n.y`, `${SH_PRODUCT} * n.y * n.z`, `${SH_AXIS} * (3.0 * n.z * n.z - 1.0)`, `${SH_PRODUCT} * n.x * n.z`,
  `${SH_DIFFERENCE} * (n.x * n.x - n.y * n.y)`,
]

/** Which coefficient a layer is, or null. */
export function harmonic({ signal }) {
  const number = /^irradianceSh([0-8])$/.exec(signal)?.[1]
  return number === undefined ? null : Number(number)
}

/** The irradiance that arrives at the unit normal `n`, in the file's world; for a place where `lightkiln<k>` are known. */
export function harmonicIrradiance(layers) {
  const terms = layers.filter(({ role }) => role === 'harmonics')
    .map((layer) => `lightkiln${layer.index} * (${HARMONICS[harmonic(layer)]})`)
  return `max(${terms.join(' + ')}, 0.0) * lightkilnIrradianceIntensity`
}
