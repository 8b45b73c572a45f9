// LIGHTKILN_lightmap, version 2, for glTF-Transform.
//
// Pages and tables are numbers, not colors. They are kept as bytes on the root property and not as textures, so that
// no transform recompresses, resizes, merges or drops them.
//
// The extension's object of a primitive says nothing that its attributes do not say as well: it is left out in memory
// and written for every primitive with all the layers' attributes. So it survives transforms that build new primitives
// from old ones (`join`).

import { Extension, ExtensionProperty, ImageUtils, PropertyType } from '@gltf-transform/core'
import { EXTENSION, primitiveLight, readExtension } from 'lightkiln-format'

const [LINEAR, NEAREST, CLAMP] = [9729, 9728, 33071]

/** The light of a file, on the document's root. See index.d.ts. */
export class Lightmap extends ExtensionProperty {
  static EXTENSION_NAME = EXTENSION

  init() {
    this.extensionName = EXTENSION
    this.propertyType = 'Lightmap'
    this.parentTypes = [PropertyType.ROOT]
  }

  getDefaults() {
    return Object.assign(super.getDefaults(), { def: {}, images: [], fallback: '', color0: '', triangles: 0 })
  }

  /** The root object as in the file; `pages` and `table` count our images. */
  getDef() { return this.get('def') }
  setDef(def) { return this.set('def', def) }
  /** `{ bytes, mimeType, uri }` each. */
  getImages() { return this.get('images') }
  setImages(images) { return this.set('images', images) }
  /** The attribute that is the light for viewers without the extension, or ''. */
  getFallback() { return this.get('fallback') }
  setFallback(semantic) { return this.set('fallback', semantic) }
  /** The attribute that keeps the asset's own colors where they were replaced, or ''. */
  getColor0() { return this.get('color0') }
  setColor0(semantic) { return this.set('color0', semantic) }
  /** How many triangles the light was baked for, see `countTriangles`. */
  getTriangles() { return this.get('triangles') }
  setTriangles(count) { return this.set('triangles', count) }
}

export class LightkilnLightmap extends Extension {
  static EXTENSION_NAME = EXTENSION
  extensionName = EXTENSION
  prewriteTypes = [PropertyType.BUFFER]

  createLightmap() {
    return new Lightmap(this.document.getGraph())
  }

  read(context) {
    const { json } = context.jsonDoc
    const lightmap = readExtension(json)
    if (lightmap === null) return this
    if (lightmap.root.profile === 'texcoord') {
      throw new Error(`${EXTENSION}: light of the profile texcoord is not for this reader: tools that quantize texture coordinates break it`)
    }

    const images = []
    const imageOf = (texture) => {
      const { source } = json.textures[texture]
      const property = context.textures[source]
      images.push({ bytes: property.getImage(), mimeType: property.getMimeType(), uri: property.getURI() })
      return images.length - 1
    }
    const layers = lightmap.layers.map(({ info, pages, table }) => {
      const numbered = { ...info, pages: pages.map(imageOf) }
      return table === null ? numbered : { ...numbered, table: imageOf(table) }
    })
    // Nothing else refers to them.
    for (const { pages, table } of lightmap.layers) {
      for (const texture of table === null ? pages : [...pages, table]) {
        context.textures[json.textures[texture].source].dispose()
      }
    }

    const { fallback, color0 } = readPrimitives(json, context, lightmap.layers)
    const property = this.createLightmap()
      .setDef({ ...lightmap.root, layers })
      .setImages(images)
      .setFallback(fallback)
      .setColor0(color0)
      .setTriangles(countTriangles(this.document, lightmap.layers))
    this.document.getRoot().setExtension(EXTENSION, property)
    return this
  }

  /** Adds the images behind those of the document, before its buffers are laid out. */
  prewrite(context) {
    const lightmap = this.document.getRoot().getExtension(EXTENSION)
    if (lightmap === null) return this
    const { json } = context.jsonDoc
    json.images ??= []
    const basename = context.options.basename || 'scene'
    const first = json.images.length
    lightmap.getImages().forEach(({ bytes, mimeType, uri }, number) => {
      const image = { mimeType }
      const name = uri || `${basename}.lightkiln.${number}.${ImageUtils.mimeTypeToExtension(mimeType)}`
      json.images.push(image)
      context.createImageData(image, bytes, { getURI: () => name, getMimeType: () => mimeType })
    })
    context.extensionData[EXTENSION] = { first }
    return this
  }

  write(context) {
    const lightmap = this.document.getRoot().getExtension(EXTENSION)
    if (lightmap === null) return this
    const { json } = context.jsonDoc
    const { first } = context.extensionData[EXTENSION]
    json.textures ??= []
    json.samplers ??= []
    const samplers = new Map()
    const textureOf = (image, filter) => {
      if (!samplers.has(filter)) {
        json.samplers.push({ magFilter: filter, minFilter: filter, wrapS: CLAMP, wrapT: CLAMP })
        samplers.set(filter, json.samplers.length - 1)
      }
      json.textures.push({ sampler: samplers.get(filter), source: first + image })
      return json.textures.length - 1
    }
    const layers = lightmap.getDef().layers.map(({ table, ...layer }) => ({
      ...layer,
      pages: layer.pages.map((page) => textureOf(page, LINEAR)),
      ...(table === undefined ? {} : { table: textureOf(table, NEAREST) }),
    }))
    json.extensions ??= {}
    json.extensions[EXTENSION] = { ...lightmap.getDef(), layers }
    writePrimitives(json, lightmap)
    const lost = lightmap.getTriangles() - countTriangles(this.document, layers)
    if (lost > 0) {
      this.document.getLogger().warn(`${EXTENSION}: ${lost} triangles with light are gone, and their neighbours may show `
        + 'light of other places; do not simplify a baked file (optimize --simplify false)')
    }
    return this
  }
}

/** What all primitives with light have in common; others lose attributes of our names, which mean nothing there. */
function readPrimitives(json, context, layers) {
  const common = { fallback: null, color0: '' }
  json.meshes?.forEach(({ primitives }, mesh) => {
    primitives.forEach((primitive, number) => {
      const property = context.meshes[mesh].listPrimitives()[number]
      const light = primitiveLight(primitive)
      if (light === null) {
        for (const { attribute } of layers) property.setAttribute(attribute, null)
        return
      }
      const fallback = light.fallback ?? ''
      const named = layers.every(({ attribute, index }) => light.attributes?.[index] === attribute)
      if (!named || (common.fallback ?? fallback) !== fallback) {
        throw new Error(`${EXTENSION}: meshes[${mesh}].primitives[${number}] differs from others in its attributes`)
      }
      common.fallback = fallback
      common.color0 = light.color0 ?? common.color0
    })
  })
  return { fallback: common.fallback ?? '', color0: common.color0 }
}

/** Triangles with light as they are drawn, instances included. */
function countTriangles(document, layers) {
  let count = 0
  const visit = (node) => {
    const instances = node.getExtension('EXT_mesh_gpu_instancing')?.listAttributes()[0]?.getCount() ?? 1
    for (const primitive of node.getMesh()?.listPrimitives() ?? []) {
      if (!layers.every(({ attribute }) => primitive.getAttribute(attribute) !== null)) continue
      const corners = (primitive.getIndices() ?? primitive.getAttribute('POSITION'))?.getCount() ?? 0
      count += instances * Math.floor(corners / 3)
    }
  }
  for (const scene of document.getRoot().listScenes()) scene.traverse(visit)
  return count
}

function writePrimitives(json, lightmap) {
  const names = lightmap.getDef().layers.map(({ attribute }) => attribute)
  for (const primitive of json.meshes?.flatMap(({ primitives }) => primitives) ?? []) {
    if (!names.every((name) => primitive.attributes[name] !== undefined)) continue
    const light = { attributes: names }
    for (const [key, name] of [['color0', lightmap.getColor0()], ['fallback', lightmap.getFallback()]]) {
      if (name !== '' && primitive.attributes[name] !== undefined) light[key] = name
    }
    primitive.extensions ??= {}
    primitive.extensions[EXTENSION] = light
  }
}
