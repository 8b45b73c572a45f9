// The light of one file: its textures and factors, and the materials that show it.

import { Constants } from '@babylonjs/core/Engines/constants.js'
import { RawTexture } from '@babylonjs/core/Materials/Textures/rawTexture.js'
import { RawTexture2DArray } from '@babylonjs/core/Materials/Textures/rawTexture2DArray.js'
import { Texture } from '@babylonjs/core/Materials/Textures/texture.js'
import { Matrix } from '@babylonjs/core/Maths/math.vector.js'
import { defaultRole, pack } from 'lightkiln-format'
import { LightkilnMaterialPlugin } from './material.js'

/** See index.d.ts. */
export class Light {
  /** `null` while textures are loading. */
  isReady = null
  plugins = new Set()
  /** The node that holds the file: harmonics are in its world. */
  root = null
  #view = null

  constructor({ layers, pageSize }, scene, options = {}) {
    const role = options.role ?? ((layer) => defaultRole(layer, layers))
    this.scene = scene
    this.pageSize = pageSize
    // Which textures there will be is known before they are, and the shaders depend on that alone.
    this.layers = layers.map((layer) => ({
      ...layer,
      role: role(layer, layers) ?? 'none',
      atlas: layer.pages.length > 0 ? undefined : null,
      palette: layer.table === null ? null : undefined,
    }))
    this.occlusionIntensity = options.occlusionIntensity ?? 1
    this.irradianceIntensity = options.irradianceIntensity ?? 1
    this.shadowIntensity = options.shadowIntensity ?? 1
  }

  async load(readTexture) {
    try {
      await Promise.all(this.used.map((layer) => this.#loadLayer(layer, readTexture)))
      this.isReady = true
    } catch (error) {
      this.isReady = false
      throw error
    } finally {
      this.#markDirty()
    }
  }

  async #loadLayer(layer, readTexture) {
    const channels = layer.channels === 1 ? 1 : 4
    const format = channels === 1 ? Constants.TEXTUREFORMAT_R : Constants.TEXTUREFORMAT_RGBA
    const typeOf = (half) => (half ? Constants.TEXTURETYPE_HALF_FLOAT : Constants.TEXTURETYPE_UNSIGNED_BYTE)
    if (layer.atlas === undefined) {
      const pages = await Promise.all(layer.pages.map(readTexture))
      const { data, width, height, layers, half } = pack(pages, channels)
      if (width !== this.pageSize[0] || height !== this.pageSize[1]) {
        throw new Error(`pages have ${width} x ${height} texels, not the ${this.pageSize.join(' x ')} that the file names`)
      }
      const settings = [format, this.scene, false, false, Texture.BILINEAR_SAMPLINGMODE, typeOf(half)]
      layer.atlas = clamped(layers === 1 ? new RawTexture(data, width, height, ...settings)
        : new RawTexture2DArray(data, width, height, layers, ...settings))
    }
    if (layer.palette === undefined) {
      const { data, width, height, half } = pack([await readTexture(layer.table)], channels)
      layer.palette = clamped(new RawTexture(data, width, height, format, this.scene, false, false,
        Texture.NEAREST_SAMPLINGMODE, typeOf(half)))
    }
  }

  /** Layers that a shader evaluates. */
  get used() {
    return this.layers.filter(({ role }) => role !== 'none')
  }

  get view() {
    return this.#view
  }

  set view(signal) {
    if (signal !== null && !this.used.some((layer) => layer.signal === signal)) throw new Error(`no layer "${signal}" is loaded`)
    this.#view = signal
    this.#markDirty()
  }

  apply(material) {
    this.plugins.add(new LightkilnMaterialPlugin(material, this))
  }

  /** Turns normals of the scene into those of the file, a 3 x 3 matrix column by column; lengths are left to the shader. */
  fromWorld() {
    const m = this.root === null ? Matrix.IdentityReadOnly.m : this.root.getWorldMatrix().m
    return Float32Array.of(m[0], m[4], m[8], m[1], m[5], m[9], m[2], m[6], m[10])
  }

  dispose() {
    for (const { atlas, palette } of this.layers) {
      atlas?.dispose()
      palette?.dispose()
    }
  }

  #markDirty() {
    for (const { material } of this.plugins) material.markAsDirty(Constants.MATERIAL_AllDirtyFlag)
  }
}

function clamped(texture) {
  texture.wrapU = texture.wrapV = Texture.CLAMP_ADDRESSMODE
  texture.anisotropicFilteringLevel = 1 // more would ask for derivatives, which the lookup has not
  texture.gammaSpace = false
  return texture
}
