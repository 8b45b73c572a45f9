// Codes into light: the twin of crates/encode/src/decode.rs and of the shaders (Schaefer et al. 2012, section 4.3).
//
// The vertex stage splits a code into a color C, a place UV and a share eta (1 at texture-vertices, 0 at
// color-vertices); all are interpolated; the fragment stage shows C + eta * atlas(UV / eta). Up to there values are
// those stored, in 0..1; `undo` turns them into the signal's own unit, after all interpolation.
//
// Deviation: double precision, where GPUs and the Rust decoder use single.

import {
  COLOR_FLAG, COLOR_STEPS, CURVE_BASE, CURVE_KNEE, ETA_EPSILON, LOW_BITS, RGB_SHIFTS, RGB_STEPS, SUBTEXELS,
} from './constants.js'

const clamp = (x, low, high) => Math.min(Math.max(x, low), high)
const mix = (a, b, share) => a * (1 - share) + b * share

export const isColor = (code) => code[1] >= COLOR_FLAG

/** The 31 bits of a color-vertex beside its flag. */
export const colorBits = (code) => (code[1] - COLOR_FLAG) * 2 ** LOW_BITS + code[0]

/** The color of a color-vertex in 0..1: one number for scalar layers, else three. */
export function color(code, form, table) {
  if (form === 'scalar') return [code[0] / COLOR_STEPS]
  const bits = colorBits(code)
  if (form === 'rgb') return RGB_SHIFTS.map((shift, c) => ((bits >>> shift) & RGB_STEPS[c]) / RGB_STEPS[c])
  const full = table.bits === 16 ? 65535 : 255
  return Array.from({ length: table.channels }, (_, c) => table.data[bits * table.channels + c] / full)
}

/** The vertex stage. */
export function vertex(code, form, table) {
  if (isColor(code)) return { color: color(code, form, table), position: [0, 0], eta: 0 }
  return { color: [], position: [code[0] / SUBTEXELS, code[1] / SUBTEXELS], eta: 1 }
}

/** The pages of an atlas as one stack. `size` is that of one page in texels; a layer without pages reads as 0. */
export function atlasView(size, pages) {
  const wrong = pages.findIndex((page) => page.width !== size[0] || page.height !== size[1])
  if (wrong >= 0) {
    throw new Error(`page ${wrong} has ${pages[wrong].width} x ${pages[wrong].height} texels, not ${size[0]} x ${size[1]}`)
  }
  return { size, pages }
}

/** The bilinear value of a channel at a place of the stack, in texels, clamped to its page. */
export function lookup({ size: [width, height], pages }, [u, v], channel) {
  if (pages.length === 0 || !Number.isFinite(u + v)) return 0
  const number = clamp(Math.floor(v / height), 0, pages.length - 1)
  const { data, channels, bits } = pages[number]
  if (channel >= channels) return 0
  const full = bits === 16 ? 65535 : 255
  const [x, y] = [u - 0.5, v - number * height - 0.5]
  const [left, top] = [Math.floor(x), Math.floor(y)]
  const texel = (i, j) =>
    data[(clamp(j, 0, height - 1) * width + clamp(i, 0, width - 1)) * channels + channel] / full
  return mix(
    mix(texel(left, top), texel(left + 1, top), x - left),
    mix(texel(left, top + 1), texel(left + 1, top + 1), x - left),
    y - top,
  )
}

/**
 * The stored value at a point of a triangle: a number per channel, 1 or 3.
 *
 * - `codes`: of the three corners, pairs of integers
 * - `barycentric`: weights of the second and third corner
 */
export function decode(codes, [second, third], atlas, form, table) {
  const weights = [1 - second - third, second, third]
  const corners = codes.map((code) => vertex(code, form, table))
  const sum = (of) => of(corners[0]) * weights[0] + of(corners[1]) * weights[1] + of(corners[2]) * weights[2]
  const channels = form === 'scalar' || (form === 'table' && table.channels < 3) ? 1 : 3
  const light = Array.from({ length: channels }, (_, c) => sum((corner) => corner.color[c] ?? 0))
  const eta = sum((corner) => corner.eta)
  if (!(eta > ETA_EPSILON)) return light
  const place = [sum((corner) => corner.position[0]) / eta, sum((corner) => corner.position[1]) / eta]
  return light.map((c, channel) => c + eta * lookup(atlas, place, channel))
}

/** The signal's value of a stored one. */
export function undo(unit, { low, extent, white }) {
  const p = low + unit * extent
  return white > 0 ? (Math.sign(p) * (CURVE_BASE ** Math.abs(p) - 1) * white) / CURVE_KNEE : p
}

/** What a layer shows of the signal's value at a point: clamped where the layer asks for it (Kavan et al. 2011, section 3.3). */
export const clamped = (light, ends) => (ends === null || ends === undefined ? light : clamp(light, ends[0], ends[1]))

/** What undoes a layer's curve: P(low), P(high) - P(low), and white, which is 0 for the linear curve. */
export function scaleOf({ curve, range: [low, high], white = 0 }) {
  const log = curve === 'log'
  const perceived = (x) =>
    log ? (Math.sign(x) * Math.log1p((CURVE_KNEE * Math.abs(x)) / white)) / Math.log(CURVE_BASE) : x
  return { low: perceived(low), extent: perceived(high) - perceived(low), white: log ? white : 0 }
}
