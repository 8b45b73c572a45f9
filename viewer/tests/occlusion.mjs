// What a viewer without any plugin sees of a file of the profile `stock` or `lightmap`: occlusion textures and the sets of
// texture coordinates that materials name, read by glTF-Transform.

import { Primitive } from '@gltf-transform/core'
import { atlasView, lookup, readPng } from 'lightkiln-format'
import { io } from './scene.mjs'

/**
 * - returns: `triangles`, each `{ corners: three points in world space, codes: three texture coordinates, or null where
 *   its material shows no occlusion }`, and `layer` with `light(triangle, barycentric)`
 */
export async function readOcclusion(bytes) {
  const document = await io.readBinary(bytes)
  const pages = new Map()
  for (const texture of document.getRoot().listTextures()) {
    if (texture.getMimeType() !== 'image/png') continue
    const page = await readPng(texture.getImage())
    pages.set(texture, atlasView([page.width, page.height], [page]))
  }
  const triangles = []
  document.getRoot().listScenes()[0].traverse((node) => {
    const world = node.getWorldMatrix()
    for (const primitive of node.getMesh()?.listPrimitives() ?? []) {
      if (primitive.getMode() === Primitive.Mode.TRIANGLES) addTriangles(triangles, primitive, world, pages)
    }
  })
  const light = ({ codes, page }, [v, w]) => {
    const [width, height] = page.size
    const at = [0, 1].map((k) => codes[0][k] * (1 - v - w) + codes[1][k] * v + codes[2][k] * w)
    return [lookup(page, [at[0] * width, at[1] * height], 0)]
  }
  return { triangles, layer: { light } }
}

function addTriangles(triangles, primitive, m, pages) {
  const material = primitive.getMaterial()
  const page = pages.get(material?.getOcclusionTexture())
  const info = material?.getOcclusionTextureInfo()
  // What quantizing tools put in the place of larger numbers.
  const { offset = [0, 0], scale = [1, 1] } = page ? transformOf(info) : {}
  const coordinates = page && primitive.getAttribute(`TEXCOORD_${info.getTexCoord()}`)
  const position = primitive.getAttribute('POSITION')
  const point = (i) => {
    const [x, y, z] = position.getElement(i, [])
    return [0, 1, 2].map((k) => m[k] * x + m[4 + k] * y + m[8 + k] * z + m[12 + k])
  }
  const uv = (i) => coordinates.getElement(i, []).map((x, k) => offset[k] + scale[k] * x)
  const indices = primitive.getIndices()?.getArray() ?? Uint32Array.from({ length: position.getCount() }, (_, i) => i)
  for (let t = 0; t + 2 < indices.length; t += 3) {
    const corners = [...indices.subarray(t, t + 3)]
    triangles.push({ corners: corners.map(point), codes: coordinates ? corners.map(uv) : null, page })
  }
}

function transformOf(info) {
  const transform = info.getExtension('KHR_texture_transform')
  if (transform === null) return {}
  if (transform.getRotation() !== 0) throw new Error('a turned texture')
  return { offset: transform.getOffset(), scale: transform.getScale() }
}
