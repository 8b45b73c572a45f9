// The glTF loader extension of Babylon.js: brings the attributes that its loader drops, and gives materials the light.

import { VertexBuffer } from '@babylonjs/core/Buffers/buffer.js'
import { DracoDecoder } from '@babylonjs/core/Meshes/Compression/dracoDecoder.js'
import { registerGLTFExtension, unregisterGLTFExtension } from '@babylonjs/loaders/glTF/2.0/glTFLoaderExtensionRegistry.js'
import { EXTENSION, attributeName, preparePrimitive, primitiveLight, readExtension, readImage } from 'lightkiln-format'
import { Light } from './light.js'
import { LightkilnMaterialPlugin } from './material.js'

export { Light, LightkilnMaterialPlugin }

const DRACO = 'KHR_draco_mesh_compression'

/** Lets Babylon's glTF loader show baked light. See index.d.ts. */
export function registerLightkiln(options = {}) {
  unregisterGLTFExtension(EXTENSION)
  registerGLTFExtension(EXTENSION, true, (loader) => new LightkilnLoader(loader, options))
}

class LightkilnLoader {
  name = EXTENSION
  /** Before extensions that load vertices or material properties, for they end the search. 0 would mean last. */
  order = 1
  light = null
  loading = null // resolves to whether the light is there
  prepared = new WeakSet()
  active = new Set()

  constructor(loader, options) {
    this.loader = loader
    this.options = options
    this.enabled = loader.isExtensionUsed(EXTENSION)
  }

  dispose() {
    this.loader = null
  }

  onLoading() {
    const failed = (error) => {
      console.warn(`babylon-lightkiln: the fallback is shown: ${error.message}`)
      return false
    }
    try {
      const lightmap = readExtension(this.loader.gltf)
      if (lightmap === null) return
      const light = new Light(lightmap, this.loader.babylonScene, this.options)
      if (light.used.length === 0) throw new Error('no layer has a role')
      this.light = light
      this.options.onLight?.(this.light)
      this.loading = this.light.load((texture) => this.readTexture(texture)).then(() => true, failed)
    } catch (error) {
      failed(error)
    }
  }

  async readTexture(index) {
    const { images, textures } = this.loader.gltf
    const image = images[textures[index].source]
    const bytes = await this.loader.loadImageAsync(`/images/${image.index}`, image)
    return readImage(new Uint8Array(bytes.buffer, bytes.byteOffset, bytes.byteLength), image.mimeType)
  }

  /** Materials get the light when they are made: once they are compiled they take no plugins. */
  loadMaterialPropertiesAsync(context, material, babylonMaterial) {
    this.addPlugin(babylonMaterial)
    return null
  }

  addPlugin(material) {
    if (this.light === null || material?.getClassName() !== 'PBRMaterial') return
    if (material.pluginManager?.getPlugin(LightkilnMaterialPlugin.NAME) == null) this.light.apply(material)
  }

  _loadVertexDataAsync(context, primitive, mesh) {
    if (this.loading === null || primitiveLight(primitive) === null || this.active.has(primitive)) return null
    return this.loadVertexData(context, primitive, mesh)
  }

  async loadVertexData(context, primitive, mesh) {
    const isLit = await this.loading
    this.light.root ??= this.loader.rootBabylonMesh
    if (isLit && !this.prepared.has(primitive)) {
      preparePrimitive(primitive, this.light.layers)
      this.prepared.add(primitive)
    }
    // The loader asks us again for this primitive while it is active, and then the other extensions.
    this.active.add(primitive)
    const loading = this.loader._loadVertexDataAsync(context, primitive, mesh)
    this.active.delete(primitive)
    const geometry = await loading
    if (!isLit) return geometry
    const layers = this.light.layers.filter(({ role }) => role !== 'none')
    await (primitive.extensions[DRACO] === undefined
      ? this.loadAttributes(context, primitive, layers, geometry)
      : this.decodeAttributes(context, primitive, layers, geometry))
    if (mesh.material === null) return geometry
    this.addPlugin(mesh.material) // the default material, which has no properties to load
    return geometry
  }

  async loadAttributes(context, primitive, layers, geometry) {
    for (const layer of layers) {
      const accessor = this.loader.gltf.accessors[primitive.attributes[layer.attribute]]
      const kind = attributeName(layer)
      const buffer = await this.loader._loadVertexAccessorAsync(`${context}/attributes/${layer.attribute}`, accessor, kind)
      geometry.setVerticesBuffer(buffer, accessor.count)
    }
  }

  /** Babylon's Draco extension decodes the attributes that it knows; ours are decoded here. */
  async decodeAttributes(context, primitive, layers, geometry) {
    const { bufferView, attributes } = primitive.extensions[DRACO]
    const ids = Object.fromEntries(layers.map((layer) => [attributeName(layer), attributes[layer.attribute]]))
    const normalized = Object.fromEntries(Object.keys(ids).map((kind) => [kind, false]))
    const bytes = await this.loader.loadBufferViewAsync(`${context}/extensions/${DRACO}`, this.loader.gltf.bufferViews[bufferView])
    const data = await DracoDecoder.Default.decodeMeshToMeshDataAsync(bytes, ids, normalized)
    const engine = this.loader.babylonScene.getEngine()
    for (const { kind, data: codes, size, byteOffset, byteStride } of data.attributes) {
      const options = { label: kind, size, offset: byteOffset, stride: byteStride, useBytes: true, normalized: false }
      geometry.setVerticesBuffer(new VertexBuffer(engine, codes, kind, options), data.totalVertices)
    }
  }
}

