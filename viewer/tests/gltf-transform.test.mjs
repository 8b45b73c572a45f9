// gltf-transform-lightkiln: after everything that people do to a finished file, the light decodes to the same values.

import assert from 'node:assert/strict'
import { execFile } from 'node:child_process'
import { mkdtemp, readFile, rm, writeFile } from 'node:fs/promises'
import { tmpdir } from 'node:os'
import { join } from 'node:path'
import { test } from 'node:test'
import { fileURLToPath } from 'node:url'
import { promisify } from 'node:util'
import * as functions from '@gltf-transform/functions'
import { EXTENSION } from 'lightkiln-format'
import { MeshoptEncoder, MeshoptSimplifier } from 'meshoptimizer'
import { bakedFiles, baked, withAllForms } from './baked.mjs'
import { addLayer, scalarCode, square } from './layers.mjs'
import { imageBytes, readGlb, writeGlb } from './glb.mjs'
import { io, readScene } from './scene.mjs'

const VIEWER = fileURLToPath(new URL('..', import.meta.url))

/** What a transform may do besides: move corners by quantization, reorder triangles, and turn or mirror them. */
const TRANSFORMS = {
  nothing: [],
  'dedup, prune': [functions.dedup(), functions.prune()],
  weld: [functions.weld()],
  unweld: [functions.unweld(), functions.weld()],
  'flatten, join': [functions.flatten(), functions.join({ keepNamed: false })],
  instance: [functions.instance({ min: 2 }), functions.uninstance()],
  quantize: [functions.quantize()],
  sparse: [functions.sparse()],
  reorder: [functions.reorder({ encoder: MeshoptEncoder })],
  meshopt: [functions.meshopt({ encoder: MeshoptEncoder, level: 'high' })],
  draco: [functions.draco()],
}

const summary = ({ triangles }) => {
  const lights = new Map()
  for (const { corners, codes } of triangles) {
    const key = [0, 1, 2].map((k) => codes?.map((layer) => [...layer[k]].join()).join(';')).sort().join(' ')
    const middle = [0, 1, 2].map((k) => corners.reduce((sum, corner) => sum + corner[k] / 3, 0))
    if (!lights.has(key)) lights.set(key, [])
    lights.get(key).push(middle)
  }
  return lights
}

/** Every triangle with its codes is there, as often as before, about where it was, and pages are the same bytes. */
function assertSameLight(before, after, tolerance) {
  const [a, b] = [summary(before), summary(after)]
  const extent = Math.max(...before.triangles.flatMap(({ corners }) => corners.flat().map(Math.abs)))
  assert.equal(b.size, a.size)
  for (const [key, middles] of a) {
    const others = b.get(key)
    assert.equal(others?.length, middles.length, `triangles with the codes ${key}`)
    for (let k = 0; k < 3; k++) {
      const sum = (list) => list.reduce((sum, middle) => sum + middle[k], 0) / list.length
      assert.ok(Math.abs(sum(middles) - sum(others)) <= tolerance * extent, `moved: ${sum(middles)} to ${sum(others)}`)
    }
  }
}

const pagesOf = async (bytes) => {
  const file = readGlb(bytes)
  return file.json.extensions[EXTENSION].layers.map(({ pages, table }) =>
    [...pages, ...(table === undefined ? [] : [table])].map((texture) => Buffer.from(imageBytes(file, texture))))
}

const moved = (name) => (['quantize', 'meshopt', 'draco'].includes(name) ? 1e-3 : 1e-6)

for (const { name, bytes } of bakedFiles) {
  test(`the light of ${name} survives all transforms`, async (t) => {
    const file = await withAllForms(bytes)
    const before = await readScene(file)
    const pages = await pagesOf(file)
    for (const [transform, steps] of Object.entries(TRANSFORMS)) {
      await t.test(transform, async () => {
        const document = await io.readBinary(file)
        await document.transform(...steps)
        const written = await io.writeBinary(document)
        assertSameLight(before, await readScene(written), moved(transform))
        assert.deepEqual(await pagesOf(written), pages)
      })
    }
  })
}

test('a texture transform does not touch pages', async () => {
  const bytes = baked('contact')
  const document = await io.readBinary(bytes)
  assert.equal(document.getRoot().listTextures().length, 0)
  const pages = await pagesOf(bytes)
  await document.transform(functions.textureCompress({ targetFormat: 'webp', resize: [16, 16] }), functions.prune())
  assert.deepEqual(await pagesOf(await io.writeBinary(document)), pages)
})

test('the objects are written as they were read', async () => {
  const bytes = await withAllForms(baked('contact'))
  const [before, after] = [readGlb(bytes), readGlb(await io.writeBinary(await io.readBinary(bytes)))]
  const root = ({ json }) => ({
    ...json.extensions[EXTENSION],
    layers: json.extensions[EXTENSION].layers.map(({ pages, table, ...layer }) => ({ ...layer, count: pages.length })),
  })
  assert.deepEqual(root(after), root(before))
  const primitive = ({ json }) => json.meshes[0].primitives[0].extensions[EXTENSION]
  assert.deepEqual(primitive(after), primitive(before))
  assert.ok(!(after.json.extensionsRequired ?? []).includes(EXTENSION))
})

test('fallback and colors of the asset keep their names, also through join', async () => {
  const layers = [{ signal: 'ambientOcclusion', codes: [0.1, 0.2, 0.3, 0.4].map(scalarCode) }]
  const file = readGlb(square({ layers, color0: [0.5, 0.5, 0.5] }))
  file.json.nodes = [{ mesh: 0 }, { mesh: 0, translation: [3, 0, 0] }]
  file.json.scenes = [{ nodes: [0, 1] }]
  const document = await io.readBinary(writeGlb(file))
  await document.transform(functions.dedup(), functions.flatten(), functions.join({ keepNamed: false }), functions.prune())
  const { json } = readGlb(await io.writeBinary(document))
  assert.equal(json.meshes.length, 1)
  assert.deepEqual(json.meshes[0].primitives.map(({ extensions }) => extensions[EXTENSION]), [
    { attributes: ['_LIGHTUV'], color0: '_LIGHTKILN_COLOR_0', fallback: 'COLOR_0' },
  ])
})

test('attributes of our name mean nothing on primitives without the object', async () => {
  const file = readGlb(square({ layers: [{ signal: 'ambientOcclusion', codes: [0.1, 0.2, 0.3, 0.4].map(scalarCode) }] }))
  delete file.json.meshes[0].primitives[0].extensions
  const { json } = readGlb(await io.writeBinary(await io.readBinary(writeGlb(file))))
  assert.equal(json.meshes[0].primitives[0].attributes._LIGHTUV, undefined)
})

test('a file without light stays without', async () => {
  const file = readGlb(square({ layers: [] }))
  delete file.json.extensions
  delete file.json.extensionsUsed
  delete file.json.meshes[0].primitives[0].extensions
  const { json } = readGlb(await io.writeBinary(await io.readBinary(writeGlb(file))))
  assert.equal(json.extensionsUsed, undefined)
})

test('a .gltf gets its pages as files', async () => {
  const bytes = baked('contact')
  const { json, resources } = await io.writeJSON(await io.readBinary(bytes), { basename: 'room' })
  const [page] = json.extensions[EXTENSION].layers[0].pages
  const { uri } = json.images[json.textures[page].source]
  assert.equal(uri, 'room.lightkiln.0.png')
  assert.deepEqual(Buffer.from(resources[uri]), (await pagesOf(bytes))[0][0])
  const back = await io.writeBinary(await io.readJSON({ json, resources }))
  assert.deepEqual(await pagesOf(back), await pagesOf(bytes))
})

test('simplifying a baked file is warned of, and nothing else is', async () => {
  const warnings = async (...steps) => {
    const found = []
    const document = await io.readBinary(baked('instances'))
    document.setLogger({ debug() {}, info() {}, error() {}, warn: (text) => found.push(text) })
    await document.transform(...steps)
    await io.writeBinary(document)
    return found.filter((text) => text.includes(EXTENSION))
  }
  assert.deepEqual(await warnings(functions.dedup(), functions.instance({ min: 2 }), functions.weld()), [])
  const [warning] = await warnings(functions.simplify({ simplifier: MeshoptSimplifier, ratio: 0, error: 1e-3 }))
  assert.match(warning, /[0-9]+ triangles with light are gone.*--simplify false/)
})

test('optimize of the command line keeps the light by its --config', async (t) => {
  const folder = await mkdtemp(join(tmpdir(), 'lightkiln-'))
  t.after(() => rm(folder, { recursive: true }))
  const bytes = await addLayer(baked('instances'), {
    signal: 'irradiance', channels: 3, curve: 'log', range: [0, 1000], white: 500, of: (v) => [v, v * v, 1 - v],
  })
  const [input, output] = [join(folder, 'in.glb'), join(folder, 'out.glb')]
  await writeFile(input, bytes)
  const before = await readScene(bytes)
  for (const compress of ['meshopt', 'draco', 'quantize']) {
    const program = join(VIEWER, 'node_modules/@gltf-transform/cli/bin/cli.js')
    const config = join(VIEWER, 'gltf-transform-lightkiln/config.mjs')
    const flags = ['--config', config, '--compress', compress, '--simplify', 'false']
    await promisify(execFile)(process.execPath, [program, 'optimize', input, output, ...flags])
    const written = new Uint8Array(await readFile(output))
    assertSameLight(before, await readScene(written), 1e-3)
    assert.deepEqual(await pagesOf(written), await pagesOf(bytes))
  }
})
