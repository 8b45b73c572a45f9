// The eta-blend as additions to three's own materials (Schaefer et al. 2012, section 4.3).
//
// By the GLSL of lightkiln-format its texels are asked for where `main` begins, and it is evaluated and used where three's lights are
// summed up, so that a GPU need not wait for them in between:
//
//   live direct light     * shadow
//   live indirect light   * occlusion       as three does it with an aoMap
//                         + irradiance      as three does it with a lightMap; not dimmed by our own occlusion, for
//                                           baked irradiance is occluded already
//                                           (harmonics: for the normal of the pixel)
//                         * aoMap           the material's own, in three's chunk behind ours

import { fragmentDeclarations, fragmentLight, fragmentMain, fragmentTexels, harmonicIrradiance, vertexDeclarations, vertexMain } from 'lightkiln-format'

/** Where lights are summed up: in materials that are lit, and in others. */
const [LIT, UNLIT] = ['#include <lights_fragment_end>', '#include <aomap_fragment>']

/** Adds the light to the two stages of a material of three. */
export function shaderStages(shader, layers, view) {
  shader.vertexShader = beginMain(shader.vertexShader, vertexDeclarations(layers), vertexMain(layers))
  const declarations = `${fragmentDeclarations(layers)}\nuniform mat3 lightkilnFromWorld;`
  const uses = (role) => layers.some((layer) => layer.role === role)
  const sum = [LIT, UNLIT].find((include) => shader.fragmentShader.includes(include))
  // Where there is no sum, the values can be looked at all the same.
  const [early, late] = sum ? [fragmentTexels(layers), `${fragmentLight(layers)}\n`] : [fragmentMain(layers), '']
  let fragment = beginMain(shader.fragmentShader, declarations, early)
  if (sum === LIT) fragment = after(fragment, LIT, `${late}${lighting(uses, layers)}`)
  else fragment = before(fragment, UNLIT, `${late}${basicLighting(uses)}`)
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

/** Behind three's sum of lights, in materials that are lit. */
function lighting(uses, layers) {
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
  const harmonics = uses('harmonics') ? `{
    vec3 n = normalize(lightkilnFromWorld * (vec4(normal, 0.0) * viewMatrix).xyz);
    lightkilnIrradiance += ${harmonicIrradiance(layers)};
  }` : ''
  const irradiance = `
  ${harmonics}
  #ifdef RE_IndirectDiffuse
    RE_IndirectDiffuse(lightkilnIrradiance, geometryPosition, geometryNormal, geometryViewDir,
      geometryClearcoatNormal, material, reflectedLight);
  #endif`
  return [uses('shadow') ? shadow : '', uses('occlusion') ? occlusion : '', uses('irradiance') || uses('harmonics') ? irradiance : ''].join('')
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
