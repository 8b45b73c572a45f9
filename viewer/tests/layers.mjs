// Files with layers that a bake of one signal does not have: made from a baked file of one scalar layer.

import { COLOR_FLAG, COLOR_STEPS, EXTENSION, RGB_SHIFTS, RGB_STEPS, SUBTEXELS, isColor, readPng } from 'lightkiln-format'
import { addAccessor, addTexture, imageBytes, readGlb, readShorts, writeGlb, writePng } from './glb.mjs'

const primitivesOf = (json) => (json.meshes ?? []).flatMap(({ primitives }) => primitives)

/** The codes of a color of 31 bits. */
const colorCode = (bits) => [bits & 0xffff, COLOR_FLAG + (bits >>> 16)]

export const rgbCode = (rgb) =>
  colorCode(rgb.reduce((bits, x, c) => bits | (Math.round(Math.min(Math.max(x, 0), 1) * RGB_STEPS[c]) << RGB_SHIFTS[c]), 0))

export const scalarCode = (value) => [Math.round(value * 65535), COLOR_FLAG]

/** The same light in the profile texcoord: pairs of floats in the next sets of texture coordinates, as docs/FORMAT.md has them. */
export function asTexcoord(bytes) {
  const file = readGlb(bytes)
  const root = file.json.extensions[EXTENSION]
  root.profile = 'texcoord'
  const [width, height] = root.pageSize ?? [1, 1]
  const pairOf = ({ channels = 1, codes = 'packed', pages }) => ([x, y]) => {
    if (!isColor([x, y])) return [x / SUBTEXELS / width, y / SUBTEXELS / (height * pages.length)]
    return codes === 'packed' && channels === 1 ? [x / COLOR_STEPS, 2] : [x, 2 + y - COLOR_FLAG]
  }
  const made = new Map()
  for (const { attributes, extensions } of primitivesOf(file.json)) {
    const light = extensions?.[EXTENSION]
    if (light === undefined) continue
    let next = Object.keys(attributes).filter((name) => name.startsWith('TEXCOORD_')).length
    light.attributes = light.attributes.map((name, k) => {
      const key = `${attributes[name]} ${k}`
      if (!made.has(key)) {
        const codes = readShorts(file, attributes[name])
        const pairs = Array.from({ length: codes.length / 2 }, (_, i) => pairOf(root.layers[k])(codes.subarray(2 * i, 2 * i + 2)))
        made.set(key, addAccessor(file, Float32Array.from(pairs.flat()), 'VEC2'))
      }
      delete attributes[name]
      attributes[`TEXCOORD_${next}`] = made.get(key)
      return `TEXCOORD_${next++}`
    })
  }
  for (const layer of root.layers) delete layer.attribute
  return writeGlb(file)
}

/**
 * Adds a layer that is a function of the first, which must be scalar.
 *
 * - `of`: from the first layer's stored value to 1 or 3 stored values
 * - `form`: 'packed' or 'table'; `bits`: of the pages
 * - returns: the file with the layer
 */
export async function addLayer(bytes, { of, form = 'packed', bits = 8, ...layer }) {
  const file = readGlb(bytes)
  const root = file.json.extensions[EXTENSION]
  const attribute = `_LIGHTUV_${root.layers.length}`
  const colors = new Map() // the table: color to number
  const color = (value) => {
    const values = of(value)
    if (form === 'packed') return layer.channels === 1 ? scalarCode(values[0]) : rgbCode(values)
    const key = values.map((x) => Math.round(x * 255)).join()
    if (!colors.has(key)) colors.set(key, colors.size)
    return colorCode(colors.get(key))
  }

  const accessors = new Map()
  for (const primitive of primitivesOf(file.json)) {
    const light = primitive.extensions?.[EXTENSION]
    if (light === undefined) continue
    const first = primitive.attributes[light.attributes[0]]
    if (!accessors.has(first)) {
      const codes = readShorts(file, first)
      for (let i = 0; i < codes.length; i += 2) {
        const code = codes.subarray(i, i + 2)
        if (isColor(code)) code.set(color(code[0] / 65535))
      }
      accessors.set(first, addAccessor(file, codes, 'VEC2'))
    }
    primitive.attributes[attribute] = accessors.get(first)
    light.attributes.push(attribute)
  }

  const pages = []
  const full = bits === 16 ? 65535 : 255
  for (const texture of root.layers[0].pages) {
    const page = await readPng(imageBytes(file, texture))
    const texels = page.data.length / page.channels
    const { width, height } = page
    const data = new (bits === 16 ? Uint16Array : Uint8Array)(texels * layer.channels)
    for (let i = 0; i < texels; i++) {
      data.set(of(page.data[i * page.channels] / (page.bits === 16 ? 65535 : 255)).map((x) => Math.round(x * full)), i * layer.channels)
    }
    pages.push(addTexture(file, writePng({ width, height, channels: layer.channels, bits, data })))
  }
  const added = { ...layer, attribute, codes: form, pages }
  if (form === 'table') {
    const data = new Uint8Array(256 * Math.max(1, Math.ceil(colors.size / 256)) * layer.channels)
    for (const [key, number] of colors) data.set(key.split(',').map(Number), number * layer.channels)
    const height = data.length / layer.channels / 256
    added.table = addTexture(file, writePng({ width: 256, height, channels: layer.channels, bits: 8, data }))
  }
  root.layers.push(added)
  return writeGlb(file)
}

/**
 * A square from (-1, -1, 0) to (1, 1, 0), facing +z, whose corners have the codes given.
 *
 * - `layers`: `{ codes: four codes, pages: images, ...fields of the layer }`
 * - `material`, `extensions`, `extra`: of the glTF; `primitive`: more fields of the primitive
 */
export function square({ layers, pageSize, material = {}, extra = {}, colors = null, fallback = true, color0 = null }) {
  const file = { json: { asset: { version: '2.0' }, ...extra }, bin: new Uint8Array() }
  const { json } = file
  const attributes = {
    POSITION: addAccessor(file, new Float32Array([-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0]), 'VEC3',
      { min: [-1, -1, 0], max: [1, 1, 0] }),
    NORMAL: addAccessor(file, new Float32Array([0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1]), 'VEC3'),
    TEXCOORD_0: addAccessor(file, new Float32Array([0, 1, 1, 1, 1, 0, 0, 0]), 'VEC2'),
  }
  const light = { attributes: [] }
  const written = layers.map(({ codes, pages = [], ...layer }, number) => {
    const attribute = number === 0 ? '_LIGHTUV' : `_LIGHTUV_${number}`
    attributes[attribute] = addAccessor(file, Uint16Array.from(codes.flat()), 'VEC2')
    light.attributes.push(attribute)
    return { channels: 1, curve: 'linear', range: [0, 1], codes: 'packed', ...layer, attribute,
      pages: pages.map((page) => addTexture(file, writePng(page))) }
  })
  const colorAccessor = (rgb) =>
    addAccessor(file, new Float32Array([rgb, rgb, rgb, rgb].flat()), 'VEC3')
  if (fallback) {
    attributes.COLOR_0 = colorAccessor(colors ?? [0, 0, 0])
    light.fallback = 'COLOR_0'
  }
  if (color0 !== null) {
    attributes._LIGHTKILN_COLOR_0 = colorAccessor(color0)
    light.color0 = '_LIGHTKILN_COLOR_0'
  }
  const indices = addAccessor(file, Uint16Array.from([0, 1, 2, 0, 2, 3]), 'SCALAR')
  json.materials = [material]
  json.meshes = [{ primitives: [{ attributes, indices, material: 0, extensions: { [EXTENSION]: light } }] }]
  json.nodes ??= [{ mesh: 0 }]
  json.scenes ??= [{ nodes: [0] }]
  json.scene = 0
  json.extensionsUsed = [EXTENSION, ...Object.keys(material.extensions ?? {})]
  json.extensions = { ...extra.extensions, [EXTENSION]: { version: 2, pageSize: pageSize ?? [0, 0], subtexels: 8, layers: written } }
  return writeGlb(file)
}
