// The plugin of GLTFLoader: reads the extension, then lets every material with light show it.

import { FileLoader, LoaderUtils } from 'three'
import { EXTENSION, prepare, readExtension, readImage } from 'lightkiln-format'
import { Light } from './light.js'

export { Light }

/** `loader.register((parser) => new LightkilnPlugin(parser, options))`; see index.d.ts. */
export class LightkilnPlugin {
  constructor(parser, options = {}) {
    this.name = EXTENSION
    this.parser = parser
    this.options = options
    this.light = null
  }

  /** Reads the pages first: when that fails, the file still is as it was and shows its fallback. */
  async beforeRoot() {
    const { parser } = this
    try {
      const lightmap = readExtension(parser.json)
      if (lightmap === null) return
      const light = await Light.load(lightmap, (texture) => this.readTexture(texture), this.options)
      if (light.layers.every(({ role }) => role === 'none')) throw new Error('no layer has a role')
      this.light = light
      prepare(parser.json, lightmap.layers)
    } catch (error) {
      console.warn(`three-lightkiln: the fallback is shown: ${error.message}`)
    }
  }

  async afterRoot(gltf) {
    if (this.light === null) return
    this.light.applyTo(gltf.scenes, this.parser.associations)
    gltf.userData.lightkiln = this.light
  }

  async readTexture(index) {
    const { json, options } = this.parser
    const image = json.images[json.textures[index].source]
    if (image.bufferView !== undefined) {
      const bytes = await this.parser.getDependency('bufferView', image.bufferView)
      return readImage(new Uint8Array(bytes), image.mimeType)
    }
    const loader = new FileLoader(options.manager)
    loader.setResponseType('arraybuffer')
    loader.setRequestHeader(options.requestHeader ?? {})
    loader.setWithCredentials(options.withCredentials ?? options.crossOrigin === 'use-credentials')
    const bytes = await loader.loadAsync(LoaderUtils.resolveURL(image.uri, options.path))
    return readImage(new Uint8Array(bytes), image.mimeType)
  }
}
