// lightkiln-format: the twin of crates/encode, its constants, PNG, and what it says of files that it cannot read.

import assert from 'node:assert/strict'
import { readFileSync } from 'node:fs'
import { test } from 'node:test'
import * as format from 'lightkiln-format'
import { rgbCode, scalarCode } from './layers.mjs'
import { writePng } from './glb.mjs'

const { atlasView, decode, lookup, pack, prepare, readExtension, readPng, scaleOf, undo } = format

const near = (a, b, tolerance = 1e-9) => assert.ok(Math.abs(a - b) <= tolerance, `${a} is not ${b}`)
const page = (width, height, data, bits = 8, channels = 1) => ({ width, height, channels, bits, data })
const place = (u, v) => [u * 8, v * 8]

test('constants are those of crates/encode', () => {
  const source = readFileSync(new URL('../../crates/encode/src/constants.rs', import.meta.url), 'utf8')
  const names = ['COLOR_FLAG', 'COLOR_STEPS', 'RGB_STEPS', 'RGB_SHIFTS', 'LOW_BITS', 'TABLE_WIDTH', 'ETA_EPSILON', 'INTEROP_COLOR', 'CURVE_KNEE',
    'CURVE_BASE', 'SH_CONSTANT', 'SH_LINEAR', 'SH_PRODUCT', 'SH_AXIS', 'SH_DIFFERENCE']
  for (const name of names) {
    const [, text] = source.match(new RegExp(`pub const ${name}: [^=]+= ([^;]+);`)) ?? []
    assert.ok(text, `${name} is missing`)
    assert.deepEqual(Function(`return ${text}`)(), format[name], name)
  }
  const chart = readFileSync(new URL('../../crates/chart/src/chart.rs', import.meta.url), 'utf8')
  assert.match(chart, new RegExp(`SUBTEXELS: u32 = ${format.SUBTEXELS};`))
})

test('decode of three colors interpolates', () => {
  const none = atlasView([0, 0], [])
  near(decode([0, 0.5, 1].map(scalarCode), [0.25, 0.5], none, 'scalar')[0], 0.625, 1e-5)
  const [r, g, b] = decode([[1, 0, 0], [0, 1, 0], [0, 0, 1]].map(rgbCode), [0.25, 0.5], none, 'rgb')
  assert.deepEqual([r, g, b], [0.25, 0.25, 0.5])
  assert.deepEqual(decode([place(1, 1), place(1, 1), place(1, 1)], [0.3, 0.3], none, 'scalar'), [0])
})

test('decode of three texture-vertices reads the atlas', () => {
  const atlas = atlasView([2, 2], [page(2, 2, Uint8Array.of(0, 51, 102, 153))])
  const codes = [place(0.5, 0.5), place(1.5, 0.5), place(0.5, 1.5)]
  for (const [b, expected] of [[[0, 0], 0], [[1, 0], 0.2], [[0, 1], 0.4], [[0.5, 0.5], 0.3], [[0.5, 0.25], 0.2]]) {
    near(decode(codes, b, atlas, 'scalar')[0], expected)
  }
})

test('decode of a mixed triangle blends along its chart edge', () => {
  const atlas = atlasView([2, 2], [page(2, 2, Uint8Array.of(0, 255, 0, 255))])
  const codes = [place(0.5, 1), place(1.5, 1), scalarCode(1)]
  for (const [a, b, c] of [[0.2, 0.3, 0.5], [0.6, 0.4, 0], [0, 0.01, 0.99], [0, 0, 1]]) {
    near(decode(codes, [b, c], atlas, 'scalar')[0], (a + b) * (a + b > 0 ? b / (a + b) : 0) + c, 2e-5)
  }
})

test('decode of a table reads its entries', () => {
  const table = page(256, 2, new Uint8Array(256 * 2 * 3), 8, 3)
  table.data.set([255, 0, 51], 300 * 3)
  const entry = [300, format.COLOR_FLAG]
  assert.deepEqual(decode([entry, entry, entry], [0, 0], atlasView([0, 0], []), 'table', table), [1, 0, 0.2])
})

test('lookup is clamped to its page', () => {
  const pages = [page(2, 2, new Uint16Array(4), 16), page(2, 2, new Uint16Array(4).fill(65535), 16)]
  const atlas = atlasView([2, 2], pages)
  for (const [v, expected] of [[0, 0], [1.999, 0], [2, 1], [3.999, 1], [9, 1], [-5, 0]]) {
    assert.equal(lookup(atlas, [1, v], 0), expected)
  }
  assert.equal(lookup(atlas, [NaN, 1], 0), 0)
  assert.equal(lookup(atlas, [1, 1], 1), 0)
})

test('undo is the inverse of the curve', () => {
  for (const curve of ['linear', 'log']) {
    const scale = scaleOf({ curve, range: [-20, 300], white: 100 })
    near(undo(0, scale), -20, 1e-9)
    near(undo(1, scale), 300, 1e-9)
  }
  const log = scaleOf({ curve: 'log', range: [0, 500], white: 500 })
  near(undo(0.5, log), (500 * (16 ** 0.5 - 1)) / 15)
})

test('clamp comes after interpolation', () => {
  const layer = { signal: 'shadow', attribute: '_LIGHTUV', channels: 1, range: [-0.25, 1.25], clamp: [0, 1] }
  const read = (layer) => readExtension(file({ version: 2, layers: [layer] })).layers[0]
  const { scale, clamp } = read(layer)
  assert.deepEqual(clamp, [0, 1])
  assert.equal(read({ ...layer, clamp: undefined }).clamp, null)
  assert.throws(() => read({ ...layer, clamp: [1, 0] }), /no range/)
  // -0.25, 0.5 and 1.25: of these, and not of 0, 0.5 and 1, every point is interpolated.
  const codes = [0, 0.5, 1].map(scalarCode)
  const none = atlasView([0, 0], [])
  const shown = (b) => format.clamped(undo(decode(codes, b, none, 'scalar')[0], scale), clamp)
  for (const [b, expected] of [[[0, 0], 0], [[0.2, 0], 0], [[0.5, 0], 0.125], [[0.5, 0.5], 0.875], [[0, 1], 1]]) {
    near(shown(b), expected, 1e-4)
  }
  const used = { ...read(layer), role: 'shadow', atlas: null, palette: null }
  assert.equal(format.fragmentMain([used]), format.fragmentTexels([used]) + format.fragmentLight([used]))
  assert.match(format.fragmentMain([used]), /lightkiln0 = clamp\(lightkiln0, 0\.0, 1\.0\);/)
  assert.doesNotMatch(format.fragmentMain([{ ...used, clamp: null }]), /clamp\(lightkiln0/)
  assert.notEqual(format.shaderKey([used], null), format.shaderKey([{ ...used, clamp: null }], null))
})

test('png of 8 and 16 bits comes back as it was', async () => {
  for (const bits of [8, 16]) {
    for (const channels of [1, 2, 3, 4]) {
      const data = (bits === 16 ? Uint16Array : Uint8Array).from({ length: 7 * 11 * channels }, (_, i) => (i * i * 977) >> 2)
      const image = { width: 7, height: 11, channels, bits, data }
      assert.deepEqual(await readPng(writePng(image)), image)
    }
  }
})

test('png that is damaged or of another kind is told apart', async () => {
  const png = writePng(page(4, 4, new Uint8Array(16)))
  assert.equal(await readPng(new Uint8Array([255, 216, 255])), null)
  const interlaced = Uint8Array.from(png)
  interlaced[28] = 1
  assert.equal(await readPng(interlaced), null)
  const palette = Uint8Array.from(png)
  palette[25] = 3
  assert.equal(await readPng(palette), null)
  await assert.rejects(readPng(png.subarray(0, 45)), /cut off/)
  await assert.rejects(readPng(png.subarray(0, 8)), /no header/)
})

test('pack gives half floats for 16 bits and fills channels', () => {
  const gray = pack([page(2, 1, Uint16Array.of(0, 65535), 16)], 4)
  assert.ok(gray.half)
  assert.deepEqual([...gray.data], [0, 0, 0, 0x3c00, 0x3c00, 0x3c00, 0x3c00, 0x3c00])
  const value = (bits) => (bits < 1024 ? bits * 2 ** -24 : (1 + (bits & 1023) / 1024) * 2 ** ((bits >> 10) - 15))
  const all = Uint16Array.from({ length: 65536 }, (_, i) => i)
  pack([page(65536, 1, all, 16)], 1).data.forEach((bits, i) => {
    assert.ok(Math.abs(value(bits) - i / 65535) <= 2 ** -12, `${i}`)
  })
  assert.throws(() => pack([page(2, 1, new Uint8Array(2)), page(1, 1, new Uint8Array(1))], 1), /differs in size/)
})

const file = (root) => ({ extensions: { LIGHTKILN_lightmap: root }, images: [{}], textures: [{ source: 0 }] })

test('extension of an unknown kind is refused with a reason', () => {
  const layer = { signal: 'ambientOcclusion', attribute: '_LIGHTUV', channels: 1, pages: [0] }
  assert.equal(readExtension({}), null)
  // Core glTF, which viewers show by themselves.
  for (const profile of ['stock', 'lightmap']) {
    assert.equal(readExtension(file({ version: 2, profile, layers: [{ signal: 'ambientOcclusion', codes: 'coordinates', pages: [0] }] })), null)
  }
  assert.equal(readExtension(file({ version: 2, layers: [layer] })).layers[0].form, 'scalar')
  // Materials show the light of these.
  for (const profile of ['stock', 'lightmap']) assert.equal(readExtension(file({ version: 2, profile, layers: [{}] })), null)
  // Texture coordinates, whose number each primitive names.
  const pairs = readExtension(file({ version: 2, profile: 'texcoord', pageSize: [8, 4], layers: [1, 3].map((channels) => ({ ...layer, attribute: undefined, channels })) }))
  assert.deepEqual(pairs.layers.map(({ attribute, stack }) => [attribute, stack]), [['_LIGHTUV', [8, 4]], ['_LIGHTUV_1', [8, 4]]])
  const cases = [
    [{ version: 1 }, /version 1/],
    [{ version: 2 }, /no layers/],
    [{ version: 2, profile: 'spline', layers: [layer] }, /profile spline/],
    [{ version: 2, subtexels: 4, layers: [] }, /4 steps/],
    [{ version: 2, layers: [{ ...layer, pages: [3] }] }, /texture 3/],
    [{ version: 2, layers: [{ ...layer, codes: 'table' }] }, /texture undefined/],
    [{ version: 2, layers: [{ ...layer, codes: 'huffman' }] }, /huffman/],
    [{ version: 2, layers: [{ ...layer, curve: 'log' }] }, /no white/],
    [{ version: 2, layers: [{ ...layer, channels: 4 }] }, /4 channels/],
    [{ version: 2, layers: [{ ...layer, attribute: undefined }] }, /no attribute/],
  ]
  for (const [root, message] of cases) assert.throws(() => readExtension(file(root)), message)
})

test('prepare brings back the colors of the asset', () => {
  const light = (more) => ({ LIGHTKILN_lightmap: { attributes: ['_LIGHTUV'], fallback: 'COLOR_0', ...more } })
  const layers = [{ index: 0, attribute: '_LIGHTUV' }]
  const primitives = [
    { attributes: { POSITION: 0, COLOR_0: 1, _LIGHTUV: 2 }, extensions: light() },
    { attributes: { POSITION: 0, COLOR_0: 1, _LIGHTUV: 2, _MINE: 3 }, extensions: light({ color0: '_MINE' }) },
    { attributes: { POSITION: 0, COLOR_0: 1, _LIGHTUV: 2 } },
    { attributes: { POSITION: 0, _OTHER: 2 }, extensions: { LIGHTKILN_lightmap: { attributes: ['_OTHER'] } } },
  ]
  prepare({ meshes: [{ primitives }] }, layers)
  assert.deepEqual(primitives.map(({ attributes }) => attributes), [
    { POSITION: 0, _LIGHTUV: 2 },
    { POSITION: 0, _LIGHTUV: 2, COLOR_0: 3 },
    { POSITION: 0, COLOR_0: 1 },
    { POSITION: 0, _LIGHTUV: 2 },
  ])
})
