// For the command line: gltf-transform optimize in.glb out.glb --config node_modules/gltf-transform-lightkiln/config.mjs
// It names what the command line registers by itself, and our extension.

import { ALL_EXTENSIONS } from '@gltf-transform/extensions'
import draco3d from 'draco3dgltf'
import { MeshoptDecoder, MeshoptEncoder } from 'meshoptimizer'
import { LightkilnLightmap } from './index.js'

export default {
  extensions: [...ALL_EXTENSIONS, LightkilnLightmap],
  dependencies: {
    'draco3d.decoder': await draco3d.createDecoderModule(),
    'draco3d.encoder': await draco3d.createEncoderModule(),
    'meshopt.decoder': MeshoptDecoder,
    'meshopt.encoder': MeshoptEncoder,
  },
}
