// The JSON of the extension: reading it, and preparing a file for viewers that know only core glTF.

import { EXTENSION, SUBTEXELS, VERSION } from './constants.js'
import { scaleOf } from './decode.js'

const DRACO = 'KHR_draco_mesh_compression'

const fail = (message) => {
  throw new Error(`${EXTENSION}: ${message}`)
}

/** Profiles whose light materials show: nothing is to be done. */
const PLAIN = ['stock', 'lightmap']

/**
 * The root object of a glTF, checked; null where there is none, and where materials show the light without us.
 *
 * Throws an `Error` that says what is wrong: a version other than 2, a layer without codes that this reader knows.
 */
export function readExtension(json) {
  const root = json.extensions?.[EXTENSION]
  if (root === undefined || PLAIN.includes(root.profile)) return null
  const { profile = 'eta' } = root
  if (profile !== 'eta' && profile !== 'texcoord') fail(`light of the profile ${profile} is not for this reader`)
  if (root.version !== VERSION) fail(`version ${root.version} is not ${VERSION}; bake the file again`)
  if ((root.subtexels ?? SUBTEXELS) !== SUBTEXELS) fail(`${root.subtexels} steps per texel are not ${SUBTEXELS}`)
  if (!Array.isArray(root.layers)) fail('no layers')
  const pageSize = root.pageSize ?? [0, 0]
  return { pageSize, layers: root.layers.map((layer, index) => readLayer(json, layer, index, profile === 'texcoord' ? pageSize : null)), root }
}

/** `interop`: the size of a page where layers name no attribute, for it is another one in each primitive; else null. */
function readLayer(json, layer, index, interop) {
  const { signal, channels = 1, curve = 'linear', range = [0, 1], codes = 'packed', pages = [] } = layer
  const at = `layers[${index}]`
  const attribute = interop === null ? layer.attribute : index === 0 ? '_LIGHTUV' : `_LIGHTUV_${index}`
  if (typeof attribute !== 'string') fail(`${at} names no attribute`)
  if (!(channels >= 1 && channels <= 3)) fail(`${at} has ${channels} channels, not 1 to 3`)
  if (curve !== 'linear' && curve !== 'log') fail(`${at} has an unknown curve "${curve}"`)
  if (curve === 'log' && !(layer.white > 0)) fail(`${at} has a logarithmic curve and no white`)
  if (codes !== 'packed' && codes !== 'table') fail(`${at} has unknown codes "${codes}"`)
  const clamp = layer.clamp ?? null
  if (clamp !== null && !(clamp.length === 2 && clamp[0] < clamp[1])) fail(`${at} is clamped to [${clamp}], which is no range`)
  const textures = codes === 'table' ? [...pages, layer.table] : pages
  const missing = textures.find((texture) => json.images?.[json.textures?.[texture]?.source] === undefined)
  if (missing !== undefined || textures.includes(undefined)) fail(`${at} names texture ${missing}, which has no image`)
  const form = codes === 'table' ? 'table' : channels === 1 ? 'scalar' : 'rgb'
  const scale = scaleOf({ curve, range, white: layer.white })
  const table = codes === 'table' ? layer.table : null
  const stack = interop === null ? null : [Math.max(interop[0], 1), Math.max(interop[1] * pages.length, 1)]
  return { index, signal, attribute, channels, form, stack, scale, clamp, pages, table, info: layer }
}

/** The extension's object of a primitive, or null. */
export const primitiveLight = (primitive) => primitive.extensions?.[EXTENSION] ?? null

/**
 * Changes a primitive in place for a viewer that shows the light itself: with light it gets back the `COLOR_0` that the
 * asset had (or none), and its attributes are named as the layers name them; without it loses attributes of that name.
 */
export function preparePrimitive(primitive, layers) {
  const light = primitiveLight(primitive)
  for (const attributes of [primitive.attributes, primitive.extensions?.[DRACO]?.attributes]) {
    if (attributes === undefined) continue
    if (light?.fallback !== undefined) delete attributes[light.fallback]
    if (light?.color0 !== undefined) rename(attributes, light.color0, 'COLOR_0')
    for (const { index, attribute } of layers) {
      const name = light?.attributes?.[index]
      if (name === undefined) delete attributes[attribute]
      else rename(attributes, name, attribute)
    }
  }
}

/** {@link preparePrimitive} of all primitives of a glTF. */
export function prepare(json, layers) {
  for (const { primitives } of json.meshes ?? []) {
    for (const primitive of primitives) preparePrimitive(primitive, layers)
  }
}

function rename(attributes, from, to) {
  if (from === to || attributes[from] === undefined) return
  attributes[to] = attributes[from]
  delete attributes[from]
}

/** What a layer does in a picture unless the caller says otherwise. */
export function defaultRole({ signal }, layers) {
  const has = (name) => layers.some((layer) => layer.signal === name)
  if (signal === 'ambientOcclusion') return 'occlusion'
  if (signal === 'irradiance') return 'irradiance'
  if (/^irradianceSh[0-8]$/.test(signal)) return has('irradiance') ? 'none' : 'harmonics'
  // Both together are `irradiance`, and a file may hold all three.
  if (signal === 'direct' || signal === 'indirect') return has('irradiance') || has('irradianceSh0') ? 'none' : 'irradiance'
  return 'none'
}
