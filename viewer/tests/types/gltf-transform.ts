// What READMEs show of gltf-transform-lightkiln, with types.

import { NodeIO } from '@gltf-transform/core'
import { ALL_EXTENSIONS } from '@gltf-transform/extensions'
import { dedup, prune } from '@gltf-transform/functions'
import { LightkilnLightmap, type Lightmap } from 'gltf-transform-lightkiln'

const io = new NodeIO().registerExtensions([...ALL_EXTENSIONS, LightkilnLightmap])
const document = await io.read('chair.baked.glb')
await document.transform(dedup(), prune())
const lightmap = document.getRoot().getExtension<Lightmap>(LightkilnLightmap.EXTENSION_NAME)
if (lightmap !== null) console.log(lightmap.getImages().map(({ bytes, mimeType }) => [bytes.length, mimeType]), lightmap.getTriangles())
export const copy: Lightmap = document.createExtension(LightkilnLightmap).createLightmap().setFallback('COLOR_0')
// @ts-expect-error images are listed, not counted
copy.setImages(3)
