// babylon-lightkiln in headless Chromium: what is stored arrives at the pixels, and does there what Babylon's own
// ambientTexture and light intensities would do.

import assert from 'node:assert/strict'
import { after, before, test } from 'node:test'
import * as functions from '@gltf-transform/functions'
import { EXTENSION } from 'lightkiln-format'
import { MeshoptEncoder } from 'meshoptimizer'
import { bakedFiles, baked, withAllForms } from './baked.mjs'
import { floats, startBrowser } from './browser.mjs'
import { addTexture, readGlb, writeGlb } from './glb.mjs'
import { asTexcoord, rgbCode, scalarCode, square } from './layers.mjs'
import { io } from './scene.mjs'
import { STEP, assertStoredLight } from './stored.mjs'

const FRONT = { right: [1, 0, 0], up: [0, 1, 0], toward: [0, 0, 1], center: [0, 0, 0], half: 0.9, depth: 5 }

let browser, page, complaints

before(async () => {
  browser = await startBrowser()
  ;({ page, complaints } = await browser.open('/tests/pages/babylon.html'))
})
after(() => browser.close())

const load = (bytes, options = {}) => {
  browser.files.set('file.glb', bytes)
  return page.evaluate((options) => tests.load('/files/file.glb', options), options)
}
const change = (code) => page.evaluate((code) => tests.change(code), code)
const view = (signal) => page.evaluate((signal) => tests.view(signal), signal)
const pixels = async (camera = FRONT) => floats(await page.evaluate((camera) => tests.pixels(camera), camera))
const middle = async () => [...(await pixels()).slice((128 * 256 + 128) * 4, (128 * 256 + 128) * 4 + 3)]
/** Babylon warns of what Draco files of glTF-Transform say of colors. */
const quiet = () => assert.deepEqual(complaints.splice(0).filter((text) => !text.includes('Normalized flag')), [])
const near = (a, b, tolerance = 1.01 * STEP) =>
  a.forEach((x, k) => assert.ok(Math.abs(x - b[k]) <= tolerance, `${a} are not ${b}`))
/** Babylon's way from light to the screen. */
const shown = (linear) => linear.map((x) => Math.min(x, 1) ** (1 / 2.2))

const viewer = { load, view, pixels, quiet }

for (const { name, bytes } of bakedFiles) {
  test(`stored light of ${name} is what the decoder says`, async (t) => {
    await assertStoredLight(t, viewer, await withAllForms(bytes), { name })
  })
}

for (const name of ['contact', 'instances']) {
  test(`stored light of ${name} in the profile texcoord is what the decoder says`, async (t) => {
    const bytes = await withAllForms(baked(name))
    await assertStoredLight(t, viewer, bytes, { name: `texcoord of ${name}`, shown: asTexcoord(bytes) })
  })
}

const COMPRESSIONS = {
  Draco: functions.draco(),
  meshopt: functions.meshopt({ encoder: MeshoptEncoder, level: 'high' }),
}
for (const [name, transform] of Object.entries(COMPRESSIONS)) {
  test(`stored light is there after ${name}`, async (t) => {
    const document = await io.readBinary(await withAllForms(baked('instances')))
    await document.transform(transform)
    await assertStoredLight(t, viewer, await io.writeBinary(document), { name })
  })
}

const four = (code) => [code, code, code, code]
const occlusion = (byte) => ({ signal: 'ambientOcclusion', codes: four(scalarCode(byte / 255)) })
const irradiance = (rgb) => ({ signal: 'irradiance', channels: 3, codes: four(rgbCode(rgb)), range: [0, 1] })
const COLOR = [0.8, 0.5, 0.3]
const lit = (more = {}) => ({ pbrMetallicRoughness: { baseColorFactor: [...COLOR, 1], roughnessFactor: 0.6, metallicFactor: 0, ...more } })
const UNLIT = { ...lit(), extensions: { KHR_materials_unlit: {} } }
const LIGHTS = `
  new DirectionalLight('sun', new Vector3(-0.3, -0.4, -1), scene).intensity = 0.8
  scene.ambientColor = new Color3(0.5, 0.6, 0.7)
  scene.materials.forEach((material) => { material.ambientColor = new Color3(1, 1, 1) })
  const face = () => Uint8Array.from({ length: 64 }, (_, i) => [120, 160, 220, 255][i % 4])
  scene.environmentTexture = new RawCubeTexture(scene, [face(), face(), face(), face(), face(), face()], 4)
`

test('occlusion is as an ambientTexture', async () => {
  const material = { ...lit({ metallicFactor: 0.4 }), extensions: { KHR_materials_clearcoat: { clearcoatFactor: 0.5 } } }
  await load(square({ layers: [occlusion(77)], material }))
  await change(LIGHTS)
  const ours = await middle()
  await load(square({ layers: [occlusion(77)], material, fallback: false }), { plugin: false })
  await change(LIGHTS + `
    const map = RawTexture.CreateRGBATexture(new Uint8Array([77, 77, 77, 255]), 1, 1, scene, false, false, 1)
    scene.materials.forEach((material) => Object.assign(material, { ambientTexture: map, useAmbientInGrayScale: true }))
  `)
  near(ours, await middle())
  await load(square({ layers: [occlusion(255)], material }))
  await change(LIGHTS)
  assert.ok((await middle())[1] > ours[1] + 10 * STEP, 'occlusion dims nothing')
  quiet()
})

test('irradiance is E / pi times the albedo', async () => {
  await load(square({ layers: [irradiance([0.2, 0.5, 0.9])], material: UNLIT }))
  near(await middle(), shown([0.2, 0.5, 0.9].map((e, k) => (e / Math.PI) * COLOR[k])))
  await load(square({ layers: [irradiance([0.2, 0.5, 0.9])], material: lit() }), { irradianceIntensity: 2 })
  const [r, g, b] = await middle()
  const most = shown([0.4, 1, 1.8].map((e, k) => (e / Math.PI) * COLOR[k]))
  for (const [x, k] of [[r, 0], [g, 1], [b, 2]]) assert.ok(x <= most[k] + STEP && x > 0.93 * most[k], `${x} of ${most[k]}`)
  quiet()
})

test('irradiance is not dimmed by the occlusion beside it', async () => {
  for (const material of [lit(), UNLIT]) {
    await load(square({ layers: [occlusion(20), irradiance([0.2, 0.5, 0.9])], material }))
    const both = await middle()
    await load(square({ layers: [irradiance([0.2, 0.5, 0.9])], material }))
    near(both, await middle())
  }
  quiet()
})

test('harmonics are irradiance for the normal of the pixel, also when the model is turned', async () => {
  const coefficients = [[0.5, 0.75, 0.25], [0.12, 0.05, 0.02], [0.22, 0.1, 0.15], [0.07, 0.17, 0.05], [0.02, 0.05, 0.07], [0.1, 0, 0.02],
    [0.07, 0.15, 0.05], [0.05, 0.02, 0.12], [0.15, 0.07, 0.02]]
  for (const count of [1, 4, 9]) {
    const layers = coefficients.slice(0, count).map((c, k) => ({ ...irradiance(c), signal: `irradianceSh${k}` }))
    // At the normal (0, 0, 1).
    const basis = [0.28209479177387814, 0, 0.4886025119029199, 0, 0, 0, 2 * 0.31539156525252005, 0, 0]
    const e = [0, 1, 2].map((k) => coefficients.slice(0, count).reduce((sum, c, i) => sum + c[k] * basis[i], 0))
    for (const turn of ['', "const root = scene.getNodeByName('__root__'); root.rotationQuaternion = null; root.rotation.set(0.4, 0.5, 2); root.scaling.scaleInPlace(3)"]) {
      const pictures = []
      for (const layer of [layers, [irradiance(e)], [irradiance(e.map((x) => x / 2))]]) {
        await load(square({ layers: layer, material: lit() }), { irradianceIntensity: 4 })
        await change(turn)
        pictures.push(await middle())
      }
      near(pictures[0], pictures[1], 2 * STEP)
      assert.ok(pictures[0][1] > pictures[2][1] + 20 * STEP, 'light that is half as much looks the same')
    }
  }
  quiet()
})

test('shadow dims lamps, and only when it is asked for', async () => {
  const layers = [occlusion(255), { signal: 'shadow', codes: four(scalarCode(0.25)) }]
  const bytes = square({ layers, material: lit(), fallback: false })
  const sun = (intensity) => `new DirectionalLight('sun', new Vector3(-0.3, -0.4, -1), scene).intensity = ${intensity}
    scene.ambientColor = new Color3(0.1, 0.1, 0.1)
    scene.materials.forEach((material) => { material.ambientColor = new Color3(1, 1, 1) })`
  const pictures = []
  for (const [options, intensity] of [[{}, 1], [{ plugin: false }, 1], [{ roles: { shadow: 'shadow' } }, 1], [{}, 0.25]]) {
    await load(bytes, options)
    await change(sun(intensity))
    pictures.push(await middle())
  }
  near(pictures[0], pictures[1])
  near(pictures[2], pictures[3])
  assert.ok(pictures[2][0] < pictures[0][0] - 10 * STEP)
  quiet()
})

test('the fallback is off and the colors of the asset are back', async () => {
  await load(square({ layers: [occlusion(255)], material: UNLIT, colors: [0, 0, 0] }))
  near(await middle(), shown(COLOR))
  await load(square({ layers: [occlusion(255)], material: UNLIT, colors: [0, 0, 0], color0: [0.5, 1, 0.25] }))
  near(await middle(), shown([0.4, 0.5, 0.075]))
  await load(square({ layers: [occlusion(102)], material: UNLIT }))
  near(await middle(), shown(COLOR.map((x) => 0.4 * x)))
  await load(square({ layers: [occlusion(255)], material: UNLIT, colors: [0.5, 0.5, 0.5] }), { plugin: false })
  near(await middle(), shown([0.4, 0.25, 0.15]))
  quiet()
})

test('a material shared with a primitive without light shows both', async () => {
  const file = readGlb(square({ layers: [occlusion(102)], material: UNLIT, fallback: false }))
  const [{ primitives }] = file.json.meshes
  const { _LIGHTUV, ...attributes } = primitives[0].attributes
  file.json.meshes.push({ primitives: [{ attributes, indices: primitives[0].indices, material: 0 }] })
  file.json.nodes.push({ mesh: 1, translation: [1, 0, 1] })
  file.json.scenes[0].nodes.push(1)
  await load(writeGlb(file))
  const picture = await pixels()
  const at = (x) => [...picture.slice((128 * 256 + x) * 4, (128 * 256 + x) * 4 + 3)]
  near(at(64), shown(COLOR.map((x) => 0.4 * x)))
  near(at(192), shown(COLOR))
  quiet()
})

test('two nodes of one mesh, and a primitive without material, show their light', async () => {
  const file = readGlb(square({ layers: [occlusion(102)] }))
  delete file.json.meshes[0].primitives[0].material
  file.json.nodes = [{ mesh: 0, translation: [-1, 0, 0] }, { mesh: 0, translation: [1, 0, 0] }]
  file.json.scenes[0].nodes = [0, 1]
  await load(writeGlb(file))
  await view('ambientOcclusion')
  const picture = await pixels()
  for (const x of [64, 192]) near([...picture.slice((128 * 256 + x) * 4, (128 * 256 + x) * 4 + 3)], [0.4, 0.4, 0.4])
  quiet()
})

test('a file that cannot be read shows its fallback and says why', async () => {
  const broken = readGlb(square({ layers: [occlusion(255)], material: UNLIT, colors: [0.5, 0.5, 0.5] }))
  broken.json.extensions[EXTENSION].layers[0].pages = [addTexture(broken, new Uint8Array([1, 2, 3]))]
  const old = readGlb(square({ layers: [occlusion(255)], material: UNLIT, colors: [0.5, 0.5, 0.5] }))
  old.json.extensions[EXTENSION].version = 1
  const unknown = readGlb(square({ layers: [{ ...occlusion(1), signal: 'unheardOf' }], material: UNLIT, colors: [0.5, 0.5, 0.5] }))
  for (const file of [broken, old, unknown]) {
    assert.equal((await load(writeGlb(file))).lit, false)
    near(await middle(), shown([0.4, 0.25, 0.15]))
    const [complaint, ...others] = complaints.splice(0)
    assert.match(complaint, /babylon-lightkiln: the fallback is shown: /)
    assert.deepEqual(others, [])
  }
})
