// The eta-blend as a plugin of Babylon's PBRMaterial.
//
// By the GLSL of lightkiln-format texels are asked for where `main` begins, and light is evaluated before Babylon's own. Occlusion
// joins Babylon's own (`ambientTexture`), which dims the environment and not the lamps; irradiance (harmonics: for the normal of the
// pixel) is added to the diffuse light, dimmed by the material's own occlusion and not by ours; shadow dims all lamps.
//
// Materials are shared by meshes with and without light: the define LIGHTKILN is per mesh.

import { MaterialPluginBase } from '@babylonjs/core/Materials/materialPluginBase.js'
import { Vector3 } from '@babylonjs/core/Maths/math.vector.js'
import {
  attributeName, fragmentDeclarations, fragmentLight, fragmentTexels, harmonicIrradiance, shaderKey, vertexDeclarations, vertexMain,
} from 'lightkiln-format'

const onlyWithLight = (code) => `#ifdef LIGHTKILN\n${code}\n#endif\n`
const withLight = (code, without) => `\n#ifdef LIGHTKILN\n${code}\n#else\n${without}\n#endif\n`

export class LightkilnMaterialPlugin extends MaterialPluginBase {
  static NAME = 'Lightkiln'

  constructor(material, light) {
    // It is added to the list by hand: the base class would ask for the code before there is a light.
    super(material, LightkilnMaterialPlugin.NAME, 300, { LIGHTKILN: false, LIGHTKILN_KEY: 0 }, false)
    this.light = light
    this.doNotSerialize = true
    this._pluginManager._addPlugin(this)
    this._enable(true)
  }

  get material() {
    return this._material
  }

  getClassName() {
    return 'LightkilnMaterialPlugin'
  }

  /** A program is found by its defines, so they must tell lights of different layers apart. */
  prepareDefines(defines, scene, mesh) {
    const { light } = this
    const [first] = light.used
    defines.LIGHTKILN = light.isReady !== false && first !== undefined && mesh.isVerticesDataPresent(attributeName(first))
    defines.LIGHTKILN_KEY = hash(shaderKey(light.used, this.#viewed()))
  }

  isReadyForSubMesh(defines) {
    return !defines.LIGHTKILN || this.light.isReady === true
  }

  getAttributes(attributes, scene, mesh) {
    for (const layer of this.light.used) {
      if (mesh.isVerticesDataPresent(attributeName(layer))) attributes.push(attributeName(layer))
    }
  }

  getSamplers(samplers) {
    for (const { index, atlas, palette } of this.light.used) {
      if (atlas !== null) samplers.push(`lightkilnAtlas${index}`)
      if (palette !== null) samplers.push(`lightkilnTable${index}`)
    }
  }

  getUniforms() {
    const scales = this.light.used.map(({ index }) => `lightkilnScale${index}`)
    const intensities = ['lightkilnOcclusionIntensity', 'lightkilnIrradianceIntensity', 'lightkilnShadowIntensity']
    return { externalUniforms: [...scales, ...intensities, 'lightkilnPage', 'lightkilnFromWorld'] }
  }

  getActiveTextures(textures) {
    for (const { atlas, palette } of this.light.used) textures.push(...[atlas, palette].filter((texture) => texture))
  }

  hasTexture(texture) {
    return this.light.used.some(({ atlas, palette }) => texture === atlas || texture === palette)
  }

  bindForSubMesh(uniformBuffer, scene, engine, { effect, materialDefines }) {
    const { light } = this
    if (!materialDefines.LIGHTKILN || light.isReady !== true) return
    for (const { index, scale, atlas, palette } of light.used) {
      effect.setVector3(`lightkilnScale${index}`, new Vector3(scale.low, scale.extent, scale.white))
      if (atlas !== null) effect.setTexture(`lightkilnAtlas${index}`, atlas)
      if (palette !== null) effect.setTexture(`lightkilnTable${index}`, palette)
    }
    effect.setFloat2('lightkilnPage', ...light.pageSize)
    effect.setFloat('lightkilnOcclusionIntensity', light.occlusionIntensity)
    effect.setFloat('lightkilnIrradianceIntensity', light.irradianceIntensity)
    effect.setFloat('lightkilnShadowIntensity', light.shadowIntensity)
    if (light.used.some(({ role }) => role === 'harmonics')) effect.setMatrix3x3('lightkilnFromWorld', light.fromWorld())
  }

  getCustomCode(shaderType) {
    const layers = this.light.used
    if (layers.length === 0) return null
    if (shaderType === 'vertex') {
      return {
        CUSTOM_VERTEX_DEFINITIONS: onlyWithLight(vertexDeclarations(layers)),
        CUSTOM_VERTEX_MAIN_BEGIN: onlyWithLight(vertexMain(layers)),
      }
    }
    const viewed = this.#viewed()
    return {
      CUSTOM_FRAGMENT_DEFINITIONS: onlyWithLight(`${fragmentDeclarations(layers)}\nuniform mat3 lightkilnFromWorld;`),
      CUSTOM_FRAGMENT_MAIN_BEGIN: onlyWithLight(fragmentTexels(layers)),
      CUSTOM_FRAGMENT_BEFORE_LIGHTS: onlyWithLight(fragmentLight(layers)),
      ...lighting(layers),
      // Babylon asks once which points there are, so this one is always named.
      CUSTOM_FRAGMENT_BEFORE_FRAGCOLOR: onlyWithLight(
        viewed === null ? '' : `finalColor = vec4(lightkilnUnit${viewed.index}, 1.0);`),
    }
  }

  #viewed() {
    return this.light.used.find(({ signal }) => signal === this.light.view) ?? null
  }
}

/** Keys that begin with `!` are regular expressions for code of Babylon that is replaced. */
function lighting(layers) {
  const uses = (role) => layers.some((layer) => layer.role === role)
  const points = {}
  const isAdded = uses('irradiance') || uses('harmonics')
  if (uses('occlusion') || isAdded) {
    const begin = 'vec3 baseColor=surfaceAlbedo;reflectivityOutParams reflectivityOut;'
    points['!vec3 baseColor=surfaceAlbedo;reflectivityOutParams reflectivityOut;'] = withLight(
      `vec3 lightkilnOwnOcclusion = aoOut.ambientOcclusionColor;
       aoOut.ambientOcclusionColor *= lightkilnOcclusion;
       ${begin}`, begin)
    // Without an ambientTexture, Babylon's occlusion is 1 and dims lamps as well.
    const direct = 'vec3 ambientOcclusionForDirectDiffuse=aoOut.ambientOcclusionColor;'
    points['!vec3 ambientOcclusionForDirectDiffuse=aoOut\\.ambientOcclusionColor;'] =
      withLight('vec3 ambientOcclusionForDirectDiffuse=vec3(1.0);', direct)
  }
  if (uses('shadow')) {
    const begin = 'aggShadow=aggShadow/numLights;'
    points['!aggShadow=aggShadow/numLights;'] = withLight(
      `diffuseBase *= lightkilnShadow;
       #ifdef SPECULARTERM
         specularBase *= lightkilnShadow;
       #endif
       #ifdef CLEARCOAT
         clearCoatBase *= lightkilnShadow;
       #endif
       #ifdef SHEEN
         sheenBase *= lightkilnShadow;
       #endif
       ${begin}`, begin)
  }
  const unlit = uses('irradiance') ? 'finalDiffuse *= lightkilnIrradiance / 3.14159265358979;'
    : uses('occlusion') ? 'finalDiffuse *= lightkilnOcclusion;' : ''
  const harmonics = uses('harmonics') ? `{
      vec3 n = normalize(lightkilnFromWorld * normalW);
      lightkilnIrradiance += ${harmonicIrradiance(layers)};
    }` : ''
  const lit = !isAdded ? '' : `
    ${harmonics}
    vec3 lightkilnDiffuse = lightkilnIrradiance / 3.14159265358979 * surfaceAlbedo.rgb * lightkilnOwnOcclusion;
    #ifndef LEGACY_SPECULAR_ENERGY_CONSERVATION
      #if defined(METALLICWORKFLOW) || defined(SPECULAR_GLOSSINESS_ENERGY_CONSERVATION)
        lightkilnDiffuse *= clamp(vec3(1.0) - baseSpecularEnvironmentReflectance, 0.0, 1.0);
      #endif
    #endif
    #ifdef CLEARCOAT
      lightkilnDiffuse *= clearcoatOut.conservationFactor;
    #endif
    finalDiffuse += lightkilnDiffuse;`
  points.CUSTOM_FRAGMENT_BEFORE_FINALCOLORCOMPOSITION = onlyWithLight(`#ifdef UNLIT\n${unlit}\n#else\n${lit}\n#endif`)
  return points
}

/** 31 bits of a text (FNV-1a). */
function hash(text) {
  let bits = 0x811c9dc5
  for (let i = 0; i < text.length; i++) bits = Math.imul(bits ^ text.charCodeAt(i), 0x01000193)
  return bits >>> 1
}
