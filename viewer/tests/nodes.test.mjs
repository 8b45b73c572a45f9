// three-lightkiln/webgpu: the same in TSL, in WebGPURenderer with both of its backends. WebGPU runs on SwiftShader as well;
// where a browser has none, its tests are skipped.

import assert from 'node:assert/strict'
import { after, before, test } from 'node:test'
import { baked, bakedFiles, withAllForms } from './baked.mjs'
import { floats, startBrowser } from './browser.mjs'
import { asTexcoord, rgbCode, scalarCode, square } from './layers.mjs'
import { VIEWS } from './raster.mjs'
import { assertStoredLight } from './stored.mjs'

const FRONT = { right: [1, 0, 0], up: [0, 1, 0], toward: [0, 0, 1], center: [0, 0, 0], half: 0.9, depth: 5 }

let browser, page, complaints

const FLAGS = ['--enable-unsafe-webgpu', '--use-webgpu-adapter=swiftshader', '--enable-features=Vulkan', '--ignore-gpu-blocklist']
before(async () => { browser = await startBrowser({ flags: FLAGS }) })
after(() => browser.close())

const load = (bytes, options = {}) => {
  browser.files.set('file.glb', bytes)
  return page.evaluate((options) => tests.load('/files/file.glb', options), options)
}
const change = (code) => page.evaluate((code) => tests.change(code), code)
const view = (signal) => page.evaluate((signal) => tests.view(signal), signal)
const pixels = async (camera = FRONT) => floats(await page.evaluate((camera) => tests.pixelsOfNodes(camera), camera))
const middle = async () => [...(await pixels()).slice((128 * 256 + 128) * 4, (128 * 256 + 128) * 4 + 3)]
const quiet = () => assert.deepEqual(complaints.splice(0), [])
const viewer = { load, view, pixels, quiet }
const near = (a, b, tolerance = 1e-4) =>
  a.forEach((x, k) => assert.ok(Math.abs(x - b[k]) <= tolerance * Math.max(1, Math.abs(b[k])), `${a} are not ${b}`))

const four = (code) => [code, code, code, code]
const occlusion = (value) => ({ signal: 'ambientOcclusion', codes: four(scalarCode(value)) })
const irradiance = (rgb) => ({ signal: 'irradiance', channels: 3, range: [0, 4], codes: four(rgbCode(rgb.map((x) => x / 4))) })
const material = { pbrMetallicRoughness: { baseColorFactor: [0.8, 0.5, 0.3, 1], roughnessFactor: 0.4, metallicFactor: 0.1 } }
const LIGHTS = `const sun = new THREE.DirectionalLight(0xffddaa, 2); sun.position.set(1, 2, 3)
  scene.add(sun, new THREE.AmbientLight(0x88ccff, 0.7), new THREE.HemisphereLight(0xff0000, 0x00ff00, 0.5))`

for (const [backend, className] of [['webgl', 'WebGLBackend'], ['webgpu', 'WebGPUBackend']]) {
  /** Whether the backend is there; opens its page once. */
  const opened = new Map()
  const isThere = async (t) => {
    if (!opened.has(backend)) opened.set(backend, await browser.open(`/tests/pages/nodes.html?backend=${backend}`))
    ;({ page, complaints } = opened.get(backend))
    const there = (await page.evaluate(() => tests.backend())) === className
    if (!there) t.skip(`no ${backend}`)
    return there
  }

  const forms = ['contact', 'instances'].map((name) => ({ name: `${name} in the profile texcoord`, bytes: baked(name), form: asTexcoord }))
  for (const { name, bytes, form = (file) => file } of [...bakedFiles, ...forms]) {
    test(`${backend}: stored light of ${name} is what the decoder says`, async (t) => {
      if (!(await isThere(t))) return
      const file = await withAllForms(bytes)
      await assertStoredLight(t, viewer, file, { name, shown: form(file), views: VIEWS.slice(0, 1) })
    })
  }

  test(`${backend}: occlusion dims ambient light and not the sun`, async (t) => {
    if (!(await isThere(t))) return
    const pictures = []
    for (const [value, lights] of [[0.3, LIGHTS], [1, LIGHTS], [1, LIGHTS.replace('0.7', '0').replace('0.5)', '0)')]]) {
      await load(square({ layers: [occlusion(value)], material }))
      await change(lights)
      pictures.push(await middle())
    }
    const [dim, open, sun] = pictures
    near(dim, sun.map((x, k) => x + 0.3 * (open[k] - x)), 1e-3)
    quiet()
  })

  test(`${backend}: irradiance adds to ambient light and is not dimmed by the occlusion beside it`, async (t) => {
    if (!(await isThere(t))) return
    const e = [0.4, 1.5, 3]
    const show = async (layers, code) => {
      await load(square({ layers, material }))
      await change(code)
      return middle()
    }
    const alone = await show([irradiance(e)], '')
    near(await show([occlusion(0.2), irradiance(e)], ''), alone, 1e-3)
    const ambient = `scene.add(Object.assign(new THREE.AmbientLight(), { color: new THREE.Color(${e}) }))`
    near(alone, await show([occlusion(1)], ambient), 3e-3)
    quiet()
  })

  test(`${backend}: harmonics are irradiance for the normal of the pixel, also when the model is turned`, async (t) => {
    if (!(await isThere(t))) return
    // No more than four: WebGPU draws from eight vertex buffers at most.
    const c = [[2, 3, 1], [0.5, 0.2, 0.1], [0.9, 0.4, 0.6], [0.3, 0.7, 0.2]]
    const layers = c.map((rgb, k) => ({ ...irradiance(rgb), signal: `irradianceSh${k}` }))
    // At the normal (0, 0, 1).
    const e = [0, 1, 2].map((k) => c[0][k] * 0.28209479 + c[2][k] * 0.48860251)
    const turn = 'gltf.scene.rotation.set(0.4, 0.5, 2); gltf.scene.scale.setScalar(3)'
    const pictures = []
    for (const shown of [layers, [irradiance(e)]]) {
      await load(square({ layers: shown, material }))
      await change(turn)
      pictures.push(await middle())
    }
    near(pictures[0], pictures[1], 3e-3)
    quiet()
  })

  test(`${backend}: a material without lights shows its light`, async (t) => {
    if (!(await isThere(t))) return
    const unlit = { ...material, extensions: { KHR_materials_unlit: {} } }
    await load(square({ layers: [occlusion(0.3)], material: unlit }))
    near(await middle(), [0.24, 0.15, 0.09], 1e-3)
    await load(square({ layers: [occlusion(0.3), irradiance([1, 2, 3])], material: unlit }))
    near(await middle(), [0.8, 1, 0.9].map((x) => x / Math.PI), 3e-3)
    quiet()
  })
}
