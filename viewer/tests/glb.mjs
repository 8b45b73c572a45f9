// Making the files that the tests read: GLB containers, PNG images, boxes of our format.

import { deflateSync, crc32 } from 'node:zlib'

const [MAGIC, JSON_CHUNK, BIN_CHUNK] = [0x46546c67, 0x4e4f534a, 0x004e4942]
const align = (n) => (n + 3) & ~3

/** A GLB file as its JSON and its binary chunk. */
export function readGlb(bytes) {
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength)
  if (view.getUint32(0, true) !== MAGIC) throw new Error('not a GLB file')
  const length = view.getUint32(12, true)
  const json = JSON.parse(new TextDecoder().decode(bytes.subarray(20, 20 + length)))
  const at = 20 + length
  const bin = at < bytes.length ? bytes.slice(at + 8, at + 8 + view.getUint32(at, true)) : new Uint8Array()
  return { json, bin }
}

export function writeGlb({ json, bin }) {
  const text = new TextEncoder().encode(JSON.stringify(json))
  const [textSize, binSize] = [align(text.length), align(bin.length)]
  const bytes = new Uint8Array(12 + 8 + textSize + 8 + binSize).fill(32, 20, 20 + textSize)
  const view = new DataView(bytes.buffer)
  const numbers = [[0, MAGIC], [4, 2], [8, bytes.length], [12, textSize], [16, JSON_CHUNK], [20 + textSize, binSize],
    [24 + textSize, BIN_CHUNK]]
  for (const [at, number] of numbers) view.setUint32(at, number, true)
  bytes.set(text, 20)
  bytes.set(bin, 28 + textSize)
  return bytes
}

/** Appends a buffer view to a file of `readGlb`; returns its number. */
export function addView(file, data) {
  const bytes = new Uint8Array(data.buffer, data.byteOffset, data.byteLength)
  const offset = align(file.bin.length)
  const bin = new Uint8Array(offset + align(bytes.length))
  bin.set(file.bin)
  bin.set(bytes, offset)
  file.bin = bin
  file.json.buffers ??= [{}]
  file.json.buffers[0].byteLength = bin.length
  file.json.bufferViews ??= []
  file.json.bufferViews.push({ buffer: 0, byteOffset: offset, byteLength: bytes.length })
  return file.json.bufferViews.length - 1
}

/** Appends an accessor; returns its number. */
export function addAccessor(file, data, type, more = {}) {
  const componentType = { Float32Array: 5126, Uint32Array: 5125, Uint16Array: 5123, Uint8Array: 5121 }[data.constructor.name]
  const size = { SCALAR: 1, VEC2: 2, VEC3: 3, VEC4: 4 }[type]
  file.json.accessors ??= []
  file.json.accessors.push({ bufferView: addView(file, data), componentType, count: data.length / size, type, ...more })
  return file.json.accessors.length - 1
}

/** Appends a texture of an image file; returns its number. */
export function addTexture(file, bytes) {
  for (const list of ['images', 'textures', 'samplers']) file.json[list] ??= []
  file.json.samplers.push({ magFilter: 9729, minFilter: 9729, wrapS: 33071, wrapT: 33071 })
  file.json.images.push({ mimeType: 'image/png', bufferView: addView(file, bytes) })
  file.json.textures.push({ sampler: file.json.samplers.length - 1, source: file.json.images.length - 1 })
  return file.json.textures.length - 1
}

/** Integers of an accessor of UNSIGNED_SHORT, plain or interleaved. */
export function readShorts({ json, bin }, accessor) {
  const { bufferView, byteOffset = 0, count, componentType, type } = json.accessors[accessor]
  if (componentType !== 5123) throw new Error(`accessor ${accessor} has no unsigned shorts`)
  const size = { SCALAR: 1, VEC2: 2 }[type]
  const view = json.bufferViews[bufferView]
  const stride = view.byteStride ?? 2 * size
  const data = new DataView(bin.buffer, bin.byteOffset + (view.byteOffset ?? 0) + byteOffset)
  return Uint16Array.from({ length: count * size }, (_, i) =>
    data.getUint16(Math.floor(i / size) * stride + (i % size) * 2, true))
}

export function imageBytes({ json, bin }, texture) {
  const { byteOffset = 0, byteLength } = json.bufferViews[json.images[json.textures[texture].source].bufferView]
  return bin.slice(byteOffset, byteOffset + byteLength)
}

/** A PNG file; every row is predicted by another filter, so that readers meet them all. */
export function writePng({ width, height, channels, bits, data }) {
  const bytes = bits === 16 ? Uint8Array.from({ length: 2 * data.length }, (_, i) => data[i >> 1] >> (i % 2 ? 0 : 8)) : data
  const [pixel, stride] = [(channels * bits) / 8, (width * channels * bits) / 8]
  const rows = new Uint8Array((stride + 1) * height)
  for (let y = 0; y < height; y++) {
    const filter = y % 5
    rows[y * (stride + 1)] = filter
    for (let x = 0; x < stride; x++) {
      const at = (dx, dy) => (x >= dx * pixel && y >= dy ? bytes[(y - dy) * stride + x - dx * pixel] : 0)
      const [left, up, corner] = [at(1, 0), at(0, 1), at(1, 1)]
      const distance = (value) => Math.abs(left + up - corner - value)
      const nearest = [left, up, corner].reduce((best, value) => (distance(value) < distance(best) ? value : best))
      const predicted = [0, left, up, (left + up) >> 1, nearest][filter]
      rows[y * (stride + 1) + 1 + x] = at(0, 0) - predicted
    }
  }
  const header = new DataView(new ArrayBuffer(13))
  header.setUint32(0, width)
  header.setUint32(4, height)
  header.setUint8(8, bits)
  header.setUint8(9, { 1: 0, 2: 4, 3: 2, 4: 6 }[channels])
  const chunk = (type, content) => {
    const out = new Uint8Array(12 + content.length)
    const view = new DataView(out.buffer)
    view.setUint32(0, content.length)
    out.set(new TextEncoder().encode(type), 4)
    out.set(content, 8)
    view.setUint32(8 + content.length, crc32(out.subarray(4, 8 + content.length)))
    return out
  }
  const chunks = [chunk('IHDR', new Uint8Array(header.buffer)), chunk('IDAT', deflateSync(rows)), chunk('IEND', new Uint8Array())]
  return Buffer.concat([Buffer.from([137, 80, 78, 71, 13, 10, 26, 10]), ...chunks])
}
