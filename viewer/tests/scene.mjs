// A file as triangles with codes, in world space, read by glTF-Transform: whatever compression it has.

import { Logger, NodeIO, Primitive } from '@gltf-transform/core'
import { ALL_EXTENSIONS } from '@gltf-transform/extensions'
import draco3d from 'draco3dgltf'
import { LightkilnLightmap } from 'gltf-transform-lightkiln'
import { EXTENSION, atlasView, clamped, decode, readPng, scaleOf, undo } from 'lightkiln-format'
import { MeshoptDecoder, MeshoptEncoder } from 'meshoptimizer'

await MeshoptDecoder.ready
await MeshoptEncoder.ready

export const io = new NodeIO()
  .setLogger(new Logger(Logger.Verbosity.ERROR))
  .registerExtensions([...ALL_EXTENSIONS, LightkilnLightmap])
  .registerDependencies({
    'draco3d.decoder': await draco3d.createDecoderModule(),
    'draco3d.encoder': await draco3d.createEncoderModule(),
    'meshopt.decoder': MeshoptDecoder,
    'meshopt.encoder': MeshoptEncoder,
  })

/**
 * - returns: `triangles`, each `{ corners: three points, codes: per layer three codes, or null where it has no light }`
 *   in the order of the file, and `layers` with `light(triangle, barycentric)`: what a view shows of a
 *   point: stored values, or the share of the layer's clamp
 */
export async function readScene(bytes) {
  const document = await io.readBinary(bytes)
  const lightmap = document.getRoot().getExtension(EXTENSION)
  const layers = lightmap === null ? [] : await readLayers(lightmap)
  const triangles = []
  document.getRoot().listScenes()[0].traverse((node) => {
    const world = node.getWorldMatrix()
    for (const primitive of node.getMesh()?.listPrimitives() ?? []) {
      if (primitive.getMode() === Primitive.Mode.TRIANGLES) addTriangles(triangles, primitive, world, layers)
    }
  })
  return { triangles, layers }
}

async function readLayers(lightmap) {
  const images = await Promise.all(lightmap.getImages().map(({ bytes }) => readPng(bytes)))
  const { layers, pageSize } = lightmap.getDef()
  return layers.map((layer, index) => {
    const atlas = atlasView(pageSize, layer.pages.map((page) => images[page]))
    const form = layer.codes === 'table' ? 'table' : layer.channels === 1 ? 'scalar' : 'rgb'
    const table = images[layer.table] ?? null
    const scale = scaleOf(layer)
    const stored = (triangle, barycentric) => decode(triangle.codes[index], barycentric, atlas, form, table)
    const value = (...point) => stored(...point).map((unit) => clamped(undo(unit, scale), layer.clamp))
    if (layer.clamp === undefined) return { ...layer, light: stored, value }
    const [low, high] = layer.clamp
    return { ...layer, light: (...point) => value(...point).map((x) => (x - low) / (high - low)), value }
  })
}

function addTriangles(triangles, primitive, m, layers) {
  const position = primitive.getAttribute('POSITION')
  const attributes = layers.map(({ attribute }) => primitive.getAttribute(attribute))
  const lit = attributes.length > 0 && attributes.every((attribute) => attribute !== null)
  const point = (i) => {
    const [x, y, z] = position.getElement(i, [])
    return [0, 1, 2].map((k) => m[k] * x + m[4 + k] * y + m[8 + k] * z + m[12 + k])
  }
  const code = (attribute) => (i) => attribute.getArray().subarray(2 * i, 2 * i + 2)
  const indices = primitive.getIndices()?.getArray() ?? Uint32Array.from({ length: position.getCount() }, (_, i) => i)
  for (let t = 0; t + 2 < indices.length; t += 3) {
    const corners = [...indices.subarray(t, t + 3)]
    triangles.push({
      corners: corners.map(point),
      codes: lit ? attributes.map((attribute) => corners.map(code(attribute))) : null,
    })
  }
}

