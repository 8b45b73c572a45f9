// PNG files whose pixels are numbers and not colors: read as they are stored. Browsers would convert them by color
// space, and to 8 bits, and to four channels.

const SIGNATURE = [137, 80, 78, 71, 13, 10, 26, 10]
/** Channels by PNG color type; palettes (3) are not numbers. */
const CHANNELS = { 0: 1, 2: 3, 4: 2, 6: 4 }

/** Whether bytes begin as a PNG file. */
export const isPng = (bytes) => SIGNATURE.every((byte, i) => bytes[i] === byte)

/**
 * Reads a PNG file of 8 or 16 bits, not interlaced and without a palette; null for others.
 *
 * - returns: `data` row-major from the top, channels side by side, `Uint8Array` or `Uint16Array`
 *
 * Throws an `Error` when the file is damaged.
 */
export async function readPng(bytes) {
  if (!isPng(bytes)) return null
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength)
  const compressed = []
  let header = null
  for (let at = 8; at + 12 <= bytes.length; ) {
    const length = view.getUint32(at)
    const type = String.fromCharCode(...bytes.subarray(at + 4, at + 8))
    if (at + 12 + length > bytes.length) throw new Error(`PNG: chunk ${type} is cut off`)
    if (type === 'IHDR') {
      header = {
        width: view.getUint32(at + 8),
        height: view.getUint32(at + 12),
        bits: bytes[at + 16],
        channels: CHANNELS[bytes[at + 17]],
        interlaced: bytes[at + 20] !== 0,
      }
    } else if (type === 'IDAT') compressed.push(bytes.subarray(at + 8, at + 8 + length))
    else if (type === 'IEND') break
    at += 12 + length
  }
  if (header === null) throw new Error('PNG: no header')
  const { width, height, bits, channels, interlaced } = header
  if (interlaced || channels === undefined || (bits !== 8 && bits !== 16)) return null
  const stream = new Blob(compressed).stream().pipeThrough(new DecompressionStream('deflate'))
  const rows = new Uint8Array(await new Response(stream).arrayBuffer())
  const data = unfilter(rows, (width * channels * bits) / 8, height, (channels * bits) / 8)
  return { width, height, channels, bits, data: bits === 16 ? bigEndian(data) : data }
}

/** Undoes the prediction of each row (PNG specification, section 9). */
function unfilter(rows, stride, height, pixel) {
  if (rows.length < (stride + 1) * height) throw new Error('PNG: rows are missing')
  const out = new Uint8Array(stride * height)
  for (let y = 0; y < height; y++) {
    const from = y * (stride + 1)
    const filter = rows[from]
    if (filter > 4) throw new Error(`PNG: filter ${filter} of row ${y} is unknown`)
    const to = y * stride
    for (let x = 0; x < stride; x++) {
      const left = x >= pixel ? out[to + x - pixel] : 0
      const up = y > 0 ? out[to + x - stride] : 0
      let predicted = 0
      if (filter === 1) predicted = left
      else if (filter === 2) predicted = up
      else if (filter === 3) predicted = (left + up) >> 1
      else if (filter === 4) predicted = paeth(left, up, x >= pixel && y > 0 ? out[to + x - stride - pixel] : 0)
      out[to + x] = rows[from + 1 + x] + predicted
    }
  }
  return out
}

function paeth(left, up, corner) {
  const [toLeft, toUp, toCorner] = [Math.abs(up - corner), Math.abs(left - corner), Math.abs(left + up - 2 * corner)]
  if (toLeft <= toUp && toLeft <= toCorner) return left
  return toUp <= toCorner ? up : corner
}

function bigEndian(bytes) {
  const numbers = new Uint16Array(bytes.length / 2)
  for (let i = 0; i < numbers.length; i++) numbers[i] = bytes[2 * i] * 256 + bytes[2 * i + 1]
  return numbers
}

/**
 * Reads any image: PNG files exactly; what only the browser can decode, by the browser, to 8 bits and four channels.
 */
export async function readImage(bytes, mimeType) {
  const png = await readPng(bytes)
  if (png !== null) return png
  const options = { premultiplyAlpha: 'none', colorSpaceConversion: 'none' }
  const bitmap = await createImageBitmap(new Blob([bytes], { type: mimeType }), options)
  const { width, height } = bitmap
  const context = new OffscreenCanvas(width, height).getContext('2d')
  context.drawImage(bitmap, 0, 0)
  const { data } = context.getImageData(0, 0, width, height)
  return { width, height, channels: 4, bits: 8, data: new Uint8Array(data.buffer) }
}

/**
 * Pages of equal size as the layers of one texture array, `channels` numbers a texel: 1 or 4, as GPUs hold them.
 *
 * - returns: bytes, or half floats where a page has 16 bits
 */
export function pack(images, channels) {
  const [{ width, height }] = images
  const wrong = images.findIndex((image) => image.width !== width || image.height !== height)
  if (wrong >= 0) throw new Error(`image ${wrong} differs in size from the first, ${width} x ${height}`)
  const half = images.some(({ bits }) => bits === 16)
  const size = width * height * channels
  const data = new (half ? Uint16Array : Uint8Array)(size * images.length)
  images.forEach((image, page) => {
    if (image.channels === channels && !half) return data.set(image.data, page * size)
    const full = image.bits === 16 ? 65535 : 255
    const number = half ? (x) => toHalf(x / full) : (x) => x
    for (let texel = 0; texel < width * height; texel++) {
      for (let c = 0; c < channels; c++) {
        const x = c === 3 ? full : image.data[texel * image.channels + Math.min(c, image.channels - 1)]
        data[page * size + texel * channels + c] = number(x)
      }
    }
  })
  return { width, height, layers: images.length, channels, half, data }
}

/** The nearest half float of a number in 0..1, as its bits; below 2^-14 it is subnormal. */
function toHalf(x) {
  if (x < 2 ** -14) return Math.round(x * 2 ** 24)
  const exponent = Math.floor(Math.log2(x))
  const bits = Math.round((x / 2 ** exponent - 1) * 1024)
  return (exponent + 15) * 1024 + bits // a rounded-up fraction carries into the exponent
}
