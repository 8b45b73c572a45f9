// The eta-blend as additions to three's own materials (Schaefer et al. 2012, section 4.3).
//
// Its twin in plain JavaScript is `decode` of lightkiln-format. The light is evaluated where `main` begins, so that it
// is there for every chunk that follows, and used where three's lights are summed up:
//
//   live direct light     * shadow
//   live indirect light   * occlusion       as three does it with an aoMap
//                         + irradiance      as three does it with a lightMap; not dimmed by our own occlusion, for
//                                           baked irradiance is occluded already
//                         * aoMap           the material's own, in three's chunk behind ours

import { COLOR_FLAG, COLOR_STEPS, CURVE_BASE, CURVE_KNEE, ETA_EPSILON, RGB_SHIFTS, RGB_STEPS, SUBTEXELS, TABLE_WIDTH }
  from 'lightkiln-format'

const float = (x) => (Number.isInteger(x) ? `${x}.0` : `${x}`)

const nameOf = ({ attribute }) => attribute.toLowerCase()
const typeOf = ({ channels }) => (channels === 1 ? 'float' : 'vec3')

/** What distinguishes two programs. */
export function shaderKey(layers, view) {
  const parts = layers.map((l) => [l.index, nameOf(l), l.channels, l.form, l.role, l.atlas === null ? 0 : 1].join(','))
  return `lightkiln:${parts.join(';')}:${view?.index ?? ''}`
}

/** Adds the light to the two stages of a material of three. */
export function shaderStages(shader, layers, view) {
  shader.vertexShader = beginMain(shader.vertexShader, vertexDeclarations(layers), vertexMain(layers))
  let fragment = beginMain(shader.fragmentShader, fragmentDeclarations(layers), fragmentMain(layers))
  const uses = (role) => layers.some((layer) => layer.role === role)
  if (fragment.includes('#include <lights_fragment_end>')) {
    fragment = after(fragment, '#include <lights_fragment_end>', lighting(uses))
  } else {
    fragment = before(fragment, '#include <aomap_fragment>', basicLighting(uses))
  }
  if (view !== null) fragment = after(fragment, '#include <dithering_fragment>', viewed(view))
  shader.fragmentShader = fragment
}

function beginMain(source, declarations, statements) {
  const main = /void\s+main\s*\(\s*(void)?\s*\)\s*\{/
  if (!main.test(source)) throw new Error('three-lightkiln: a shader without main')
  return source.replace(main, (begin) => `${declarations}\n${begin}\n${statements}\n`)
}

function after(source, include, statements) {
  if (statements === '') return source
  if (!source.includes(include)) console.warn(`three-lightkiln: no ${include} in a shader; its light is incomplete`)
  return source.replace(include, () => `${include}\n${statements}`)
}

function before(source, include, statements) {
  if (statements === '') return source
  if (!source.includes(include)) console.warn(`three-lightkiln: no ${include} in a shader; its light is incomplete`)
  return source.replace(include, () => `${statements}\n${include}`)
}

function vertexDeclarations(layers) {
  const attributes = layers.map((layer) => `
attribute vec2 ${nameOf(layer)};
varying highp ${typeOf(layer)} vLightkilnColor${layer.index};
${layer.form === 'table' ? `uniform highp sampler2D lightkilnTable${layer.index};` : ''}`)
  return `
varying highp vec3 vLightkilnPlace; // UV in texels, and eta
${attributes.join('')}
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

/** All layers of a file share the places of their texture-vertices, so one place serves them all. */
function vertexMain(layers) {
  const first = nameOf(layers[0])
  const colors = layers.map((layer) => {
    const name = nameOf(layer)
    const colorOf = {
      scalar: `lightkilnScalar(${name})`,
      rgb: `lightkilnRgb(${name})`,
      table: `lightkilnEntry(lightkilnTable${layer.index}, ${name})${layer.channels === 1 ? '.r' : ''}`,
    }
    return `
  vLightkilnColor${layer.index} = ${typeOf(layer)}(0.0);
  if (lightkilnIsColor) vLightkilnColor${layer.index} = ${colorOf[layer.form]};`
  })
  return `
  bool lightkilnIsColor = ${first}.y >= ${float(COLOR_FLAG)};
  vLightkilnPlace = lightkilnIsColor ? vec3(0.0) : vec3(${first} / ${float(SUBTEXELS)}, 1.0);
${colors.join('')}`
}

function fragmentDeclarations(layers) {
  const uniforms = layers.map(({ index, atlas, ...layer }) => `
varying highp ${typeOf(layer)} vLightkilnColor${index};
uniform highp vec3 lightkilnScale${index}; // P(low), P(high) - P(low), white or 0
${atlas === null ? '' : `uniform highp sampler2DArray lightkilnAtlas${index};`}`)
  return `
varying highp vec3 vLightkilnPlace;
uniform float lightkilnOcclusionIntensity;
uniform float lightkilnIrradianceIntensity;
uniform float lightkilnShadowIntensity;
${uniforms.join('')}
// The level is given: the lookup stands inside of a branch, and coarser levels would mix charts.
highp vec3 lightkilnLookup(highp sampler2DArray atlas) {
  highp vec3 size = vec3(textureSize(atlas, 0));
  highp vec2 place = vLightkilnPlace.xy / vLightkilnPlace.z;
  highp float page = clamp(floor(place.y / size.y), 0.0, size.z - 1.0);
  return textureLod(atlas, vec3(place.x / size.x, (place.y - page * size.y) / size.y, page), 0.0).rgb;
}
highp vec3 lightkilnUndo(highp vec3 unit, highp vec3 scale) {
  highp vec3 p = scale.x + unit * scale.y;
  if (scale.z <= 0.0) return p;
  return sign(p) * (pow(vec3(${float(CURVE_BASE)}), abs(p)) - 1.0) * (scale.z / ${float(CURVE_KNEE)});
}`
}

/** `lightkilnUnit<k>` is as stored, `lightkiln<k>` in the signal's unit; both gray for scalar layers. */
function fragmentMain(layers) {
  const values = layers.map(({ index, channels, atlas }) => {
    const lookup = `lightkilnLookup(lightkilnAtlas${index})${channels === 1 ? '.rrr' : ''}`
    return `
  highp vec3 lightkilnUnit${index} = vec3(vLightkilnColor${index});
  ${atlas === null ? '' : `if (lightkilnIsTextured) lightkilnUnit${index} += vLightkilnPlace.z * ${lookup};`}
  highp vec3 lightkiln${index} = lightkilnUndo(lightkilnUnit${index}, lightkilnScale${index});`
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
  bool lightkilnIsTextured = vLightkilnPlace.z > ${float(ETA_EPSILON)};
  float lightkilnOcclusion = 1.0;
  float lightkilnShadow = 1.0;
  vec3 lightkilnIrradiance = vec3(0.0);
${values.join('')}
${sums.join('\n')}`
}

/** Behind three's sum of lights, in materials that are lit. */
function lighting(uses) {
  const dim = (factor, [diffuse, specular, clearcoat, sheen], specularFactor) => `
  ${diffuse} *= ${factor};
  #ifdef USE_CLEARCOAT
    ${clearcoat} *= ${factor};
  #endif
  #ifdef USE_SHEEN
    ${sheen} *= ${factor};
  #endif
  ${specularFactor(specular)}`
  const direct = ['reflectedLight.directDiffuse', 'reflectedLight.directSpecular', 'clearcoatSpecularDirect',
    'sheenSpecularDirect']
  const indirect = ['reflectedLight.indirectDiffuse', 'reflectedLight.indirectSpecular', 'clearcoatSpecularIndirect',
    'sheenSpecularIndirect']
  const shadow = dim('lightkilnShadow', direct, (specular) => `${specular} *= lightkilnShadow;`)
  const occlusion = dim('lightkilnOcclusion', indirect, (specular) => `
  #if defined(USE_ENVMAP) && defined(STANDARD)
    ${specular} *= computeSpecularOcclusion(
      saturate(dot(geometryNormal, geometryViewDir)), lightkilnOcclusion, material.roughness);
  #endif`)
  const irradiance = `
  #ifdef RE_IndirectDiffuse
    RE_IndirectDiffuse(lightkilnIrradiance, geometryPosition, geometryNormal, geometryViewDir,
      geometryClearcoatNormal, material, reflectedLight);
  #endif`
  return [uses('shadow') ? shadow : '', uses('occlusion') ? occlusion : '', uses('irradiance') ? irradiance : ''].join('')
}

/** Before the aoMap of materials that are not lit: as with a lightMap, irradiance takes the place of the constant 1. */
function basicLighting(uses) {
  if (uses('irradiance')) {
    return `
  #ifndef USE_LIGHTMAP
    reflectedLight.indirectDiffuse = vec3(0.0);
  #endif
  reflectedLight.indirectDiffuse += lightkilnIrradiance * RECIPROCAL_PI;`
  }
  return uses('occlusion') ? '  reflectedLight.indirectDiffuse *= lightkilnOcclusion;' : ''
}

/** The stored values themselves: no material, no tone mapping, no color space. */
const viewed = ({ index }) => `  gl_FragColor = vec4(lightkilnUnit${index}, 1.0);`
