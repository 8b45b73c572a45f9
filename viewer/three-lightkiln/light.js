// The light of one file: its textures and uniforms, and the materials that show it.

import {
  ClampToEdgeWrapping, DataArrayTexture, DataTexture, HalfFloatType, LinearFilter, Matrix3, NearestFilter,
  NoColorSpace, RedFormat, RGBAFormat, UnsignedByteType, Vector2, Vector3,
} from 'three'
import { attributeName, defaultRole, pack, shaderKey } from 'lightkiln-format'
import { shaderStages } from './shader.js'

/** See index.d.ts. */
export class Light {
  #materials = new Map() // each material with light, and what it was before
  #view = null
  #root = null
  #nodes
  #meshes = new Set() // those with node materials
  #replaced = new Map()
  #before = new WeakMap() // node material to the material that it replaced

  /** `readTexture`: number of a glTF texture to its image. */
  static async load({ layers, pageSize }, readTexture, options = {}) {
    const role = options.role ?? ((layer) => defaultRole(layer, layers))
    const loaded = await Promise.all(
      layers.map(async (layer) => {
        const used = { ...layer, role: role(layer, layers) ?? 'none', atlas: null, palette: null }
        if (used.role === 'none') return used
        const pages = await Promise.all(layer.pages.map(readTexture))
        if (pages.length > 0) used.atlas = atlasTexture(pages, layer, pageSize)
        if (layer.table !== null) used.palette = tableTexture(await readTexture(layer.table), layer)
        return used
      }),
    )
    return new Light(loaded, pageSize, options)
  }

  constructor(layers, pageSize, options = {}) {
    this.layers = layers
    this.#nodes = options.nodes ?? null
    this.uniforms = {
      lightkilnOcclusionIntensity: { value: options.occlusionIntensity ?? 1 },
      lightkilnIrradianceIntensity: { value: options.irradianceIntensity ?? 1 },
      lightkilnShadowIntensity: { value: options.shadowIntensity ?? 1 },
      lightkilnPage: { value: new Vector2(...pageSize) },
      lightkilnFromWorld: { value: new Matrix3() },
    }
    for (const { index, scale, atlas, palette } of layers) {
      this.uniforms[`lightkilnScale${index}`] = { value: new Vector3(scale.low, scale.extent, scale.white) }
      if (atlas !== null) this.uniforms[`lightkilnAtlas${index}`] = { value: atlas }
      if (palette !== null) this.uniforms[`lightkilnTable${index}`] = { value: palette }
    }
  }

  get occlusionIntensity() { return this.uniforms.lightkilnOcclusionIntensity.value }
  set occlusionIntensity(value) { this.uniforms.lightkilnOcclusionIntensity.value = value }
  get irradianceIntensity() { return this.uniforms.lightkilnIrradianceIntensity.value }
  set irradianceIntensity(value) { this.uniforms.lightkilnIrradianceIntensity.value = value }
  get shadowIntensity() { return this.uniforms.lightkilnShadowIntensity.value }
  set shadowIntensity(value) { this.uniforms.lightkilnShadowIntensity.value = value }

  get view() { return this.#view }
  set view(signal) {
    const layer = this.layers.find((layer) => layer.signal === signal)
    if (signal !== null && (layer === undefined || layer.role === 'none')) {
      throw new Error(`no layer "${signal}" is loaded`)
    }
    this.#view = signal
    for (const material of this.#materials.keys()) material.needsUpdate = true
    for (const mesh of this.#meshes) this.#applyNodes(mesh, this.#layersOf(mesh))
  }

  /** Applies the light to all meshes below `roots` that have it. Meshes without keep their materials as they are. */
  applyTo(roots, associations) {
    const meshes = []
    this.#root ??= roots[0]
    for (const root of roots) root.traverse((object) => object.isMesh && meshes.push(object))
    const dark = new Set(meshes.filter((mesh) => this.#layersOf(mesh).length === 0).flatMap((mesh) => mesh.material))
    const copies = new Map()
    const lit = (material) => {
      if (!dark.has(material)) return material
      if (!copies.has(material)) {
        const copy = material.clone()
        copy.onBeforeCompile = material.onBeforeCompile
        copy.customProgramCacheKey = material.customProgramCacheKey
        if (associations?.has(material)) associations.set(copy, associations.get(material))
        copies.set(material, copy)
      }
      return copies.get(material)
    }
    for (const mesh of meshes) {
      if (this.#layersOf(mesh).length === 0) continue
      mesh.material = Array.isArray(mesh.material) ? mesh.material.map(lit) : lit(mesh.material)
      this.apply(mesh)
    }
  }

  /** Lets the material of a mesh with light show it; again after you gave the mesh another material. */
  apply(mesh) {
    const layers = this.#layersOf(mesh)
    if (layers.length === 0) return
    if (this.#nodes !== null) this.#applyNodes(mesh, layers)
    else for (const material of [mesh.material].flat()) this.#compose(material, layers)
  }

  /** For WebGPURenderer, see webgpu.js: a node material in the place of each material. */
  #applyNodes(mesh, layers) {
    const view = layers.find((layer) => layer.signal === this.#view) ?? null
    const replace = (material) => {
      const before = this.#before.get(material) ?? material
      const key = `${before.uuid} ${shaderKey(layers, view)}`
      if (!this.#replaced.has(key)) this.#replaced.set(key, this.#nodes.material(before, this, layers, view))
      const node = this.#replaced.get(key)
      this.#before.set(node, before)
      return node
    }
    mesh.material = Array.isArray(mesh.material) ? mesh.material.map(replace) : replace(mesh.material)
    this.#meshes.add(mesh)
  }

  dispose() {
    for (const { atlas, palette } of this.layers) {
      atlas?.dispose()
      palette?.dispose()
    }
  }

  #layersOf({ geometry }) {
    return this.layers.filter((layer) => layer.role !== 'none' && geometry.hasAttribute(attributeName(layer)))
  }

  /** Adds our part of the shader after whatever the material adds already. */
  #compose(material, layers) {
    if (this.#materials.get(material) === material.onBeforeCompile) return
    const { onBeforeCompile, customProgramCacheKey } = material
    // The default key is the text of `onBeforeCompile`, which is no longer theirs.
    const hasKey = customProgramCacheKey !== Object.getPrototypeOf(material).customProgramCacheKey
    const view = () => layers.find((layer) => layer.signal === this.#view) ?? null
    material.onBeforeCompile = (shader, renderer) => {
      onBeforeCompile.call(material, shader, renderer)
      Object.assign(shader.uniforms, this.uniforms)
      shaderStages(shader, layers, view())
    }
    material.customProgramCacheKey = () => {
      const theirs = hasKey ? customProgramCacheKey.call(material) : onBeforeCompile.toString()
      return `${theirs}|${shaderKey(layers, view())}`
    }
    if (layers.some(({ role }) => role === 'harmonics')) this.#turn(material)
    material.needsUpdate = true
    this.#materials.set(material, material.onBeforeCompile)
  }

  #turn(material) {
    const { onBeforeRender } = material
    material.onBeforeRender = (...drawn) => {
      onBeforeRender.apply(material, drawn)
      this.updateFromWorld()
    }
  }

  /** Harmonics are in the world of the file, which you may have turned in yours: turns normals back. */
  updateFromWorld() {
    const { value } = this.uniforms.lightkilnFromWorld
    return this.#root === null ? value : value.setFromMatrix4(this.#root.matrixWorld).transpose()
  }
}

/** The lookup of lightkiln-format: an array of pages, or one page. */
function atlasTexture(pages, { channels }, [width, height]) {
  const page = pages.findIndex((page) => page.width !== width || page.height !== height)
  if (page >= 0) throw new Error(`page ${page} has not the ${width} x ${height} texels that the file names`)
  const { data, layers, half, ...packed } = pack(pages, channels === 1 ? 1 : 4)
  const texture = layers === 1 ? new DataTexture(data, width, height) : new DataArrayTexture(data, width, height, layers)
  return numbers(texture, packed.channels, half, LinearFilter)
}

function tableTexture(image, { channels }) {
  const { data, width, height, half, ...packed } = pack([image], channels === 1 ? 1 : 4)
  return numbers(new DataTexture(data, width, height), packed.channels, half, NearestFilter)
}

/** Not colors: no color space, no mipmaps. */
function numbers(texture, channels, half, filter) {
  texture.format = channels === 1 ? RedFormat : RGBAFormat
  texture.type = half ? HalfFloatType : UnsignedByteType
  texture.colorSpace = NoColorSpace
  texture.minFilter = texture.magFilter = filter
  texture.wrapS = texture.wrapT = ClampToEdgeWrapping
  texture.generateMipmaps = false
  texture.flipY = false
  texture.unpackAlignment = 1
  texture.needsUpdate = true
  return texture
}
