// three-lightkiln in headless Chromium: what is stored arrives at the pixels, and does there what three's own aoMap and
// lightMap would do.

import assert from 'node:assert/strict'
import { after, before, test } from 'node:test'
import { EXTENSION } from 'lightkiln-format'
import { bakedFiles, baked, withAllForms } from './baked.mjs'
import { floats, startBrowser } from './browser.mjs'
import { addTexture, imageBytes, readGlb, writeGlb } from './glb.mjs'
import { asTexcoord, rgbCode, scalarCode, square } from './layers.mjs'
import { VIEWS, cameraFor, compare, visible } from './raster.mjs'
import { readScene } from './scene.mjs'
import { STEP, assertStoredLight } from './stored.mjs'

const FRONT = { right: [1, 0, 0], up: [0, 1, 0], toward: [0, 0, 1], center: [0, 0, 0], half: 0.9, depth: 5 }

let browser, page, complaints

before(async () => {
  browser = await startBrowser()
  ;({ page, complaints } = await browser.open('/tests/pages/three.html'))
})
after(() => browser.close())

const load = (bytes, options = {}) => {
  browser.files.set('file.glb', bytes)
  return page.evaluate(([options]) => tests.load('/files/file.glb', options), [options])
}
const change = (code) => page.evaluate((code) => tests.change(code), code)
const pixels = async (camera = FRONT) => floats(await page.evaluate((camera) => tests.pixels(camera), camera))
const canvas = async (camera = FRONT) => floats(await page.evaluate((camera) => tests.canvas(camera), camera))
const view = (signal) => page.evaluate((signal) => tests.view(signal), signal)
/** The pixel in the middle. */
const middle = async () => [...(await pixels()).slice((128 * 256 + 128) * 4, (128 * 256 + 128) * 4 + 3)]
const quiet = () => assert.deepEqual(complaints.splice(0), [])
const near = (a, b, tolerance = 1e-5) =>
  a.forEach((x, k) => assert.ok(Math.abs(x - b[k]) <= tolerance * Math.max(1, Math.abs(b[k])), `${a} are not ${b}`))

const viewer = { load, view, pixels, quiet }

for (const name of ['contact', 'instances']) {
  test(`stored light of ${name} in the profile texcoord is what the decoder says`, async (t) => {
    const bytes = await withAllForms(baked(name))
    await assertStoredLight(t, viewer, bytes, { name: `texcoord of ${name}`, shown: asTexcoord(bytes) })
  })
}

for (const { name, bytes } of bakedFiles) {
  test(`stored light of ${name} is what the decoder says`, async (t) => {
    await assertStoredLight(t, viewer, await withAllForms(bytes), { name })
  })

  test(`${name} is shown without a complaint`, async () => {
    await load(bytes, { irradianceIntensity: 100 })
    await change('scene.add(new THREE.AmbientLight(0xffffff, 3), new THREE.DirectionalLight(0xffffff, 3))')
    const { triangles } = await readScene(bytes)
    const shown = await canvas(cameraFor(triangles, VIEWS[0]))
    assert.ok(shown.some((x, i) => i % 4 < 3 && x > 40), 'the picture is black')
    quiet()
  })
}

test('the canvas shows stored light in 8 bits', async () => {
  const bytes = baked('contact')
  const scene = await readScene(bytes)
  await load(bytes)
  await view('ambientOcclusion')
  const camera = cameraFor(scene.triangles, VIEWS[0])
  const shown = (await canvas(camera)).map((x) => x / 255)
  assert.equal(compare(visible(scene.triangles, camera), scene.layers[0], shown, STEP).over, 0)
  quiet()
})

test('stored light can be looked at in a material that sums up no lights, and a warning says what is missing', async () => {
  const bytes = baked('contact')
  const scene = await readScene(bytes)
  await load(bytes)
  await change(`gltf.scene.traverse((mesh) => {
    if (!mesh.isMesh) return
    mesh.material = new THREE.MeshMatcapMaterial()
    gltf.userData.lightkiln.apply(mesh)
  })`)
  await view('ambientOcclusion')
  const camera = cameraFor(scene.triangles, VIEWS[0])
  const shown = (await canvas(camera)).map((x) => x / 255)
  assert.equal(compare(visible(scene.triangles, camera), scene.layers[0], shown, STEP).over, 0)
  const said = complaints.splice(0)
  assert.ok(said.length > 0 && said.every((line) => line.includes('no #include <aomap_fragment>')), said.join('\n'))
})

const LIGHTS = `
  const environment = new THREE.Scene()
  environment.background = new THREE.Color(0.4, 0.6, 0.9)
  scene.environment = new THREE.PMREMGenerator(renderer).fromScene(environment).texture
  const sun = new THREE.DirectionalLight(0xffddaa, 2)
  sun.position.set(1, 2, 3)
  scene.add(sun, new THREE.AmbientLight(0x88ccff, 0.7), new THREE.HemisphereLight(0xff0000, 0x00ff00, 0.5))
`
const PHYSICAL = {
  pbrMetallicRoughness: { baseColorFactor: [0.8, 0.5, 0.3, 1], roughnessFactor: 0.4, metallicFactor: 0.2 },
  extensions: {
    KHR_materials_clearcoat: { clearcoatFactor: 0.7, clearcoatRoughnessFactor: 0.2 },
    KHR_materials_sheen: { sheenColorFactor: [0.2, 0.3, 0.4], sheenRoughnessFactor: 0.5 },
  },
}
const MATERIALS = {
  MeshStandardMaterial: { pbrMetallicRoughness: { baseColorFactor: [0.8, 0.5, 0.3, 1], roughnessFactor: 0.4, metallicFactor: 0.5 } },
  MeshPhysicalMaterial: PHYSICAL,
  MeshBasicMaterial: { pbrMetallicRoughness: { baseColorFactor: [0.8, 0.5, 0.3, 1] }, extensions: { KHR_materials_unlit: {} } },
}
const four = (code) => [code, code, code, code]
const occlusion = (value) => ({ signal: 'ambientOcclusion', codes: four(scalarCode(value)) })
const irradiance = (rgb, white = 10) => ({
  signal: 'irradiance', channels: 3, curve: 'log', white, range: [0, white],
  codes: four(rgbCode(rgb.map((x) => Math.log1p((15 * x) / white) / Math.log(16)))),
})
const constantMap = (name, [r, g, b]) => `
  const map = new THREE.DataTexture(new Float32Array([${r}, ${g}, ${b}, 1]), 1, 1, THREE.RGBAFormat, THREE.FloatType)
  map.needsUpdate = true
  materials.forEach((material) => { material.${name} = map; material.needsUpdate = true })
`
/** What a code of three channels stores, in the signal's unit. */
const stored = async (layer) => {
  const { layers, triangles } = await readScene(square({ layers: [layer] }))
  return layers[0].value(triangles[0], [0.3, 0.3])
}

for (const [type, material] of Object.entries(MATERIALS)) {
  test(`occlusion in a ${type} is as an aoMap`, async () => {
    assert.deepEqual((await load(square({ layers: [occlusion(0.3)], material }))).materials, [type])
    await change(LIGHTS)
    const ours = await middle()
    await load(square({ layers: [occlusion(0.3)], material, fallback: false }), { plugin: false })
    await change(LIGHTS + constantMap('aoMap', [0.3, 0.3, 0.3]))
    near(ours, await middle())
    quiet()
  })

  test(`irradiance in a ${type} is as a lightMap`, async () => {
    const layer = irradiance([0.2, 1.5, 7])
    await load(square({ layers: [layer], material }))
    await change(LIGHTS)
    const ours = await middle()
    await load(square({ layers: [layer], material, fallback: false }), { plugin: false })
    await change(LIGHTS + constantMap('lightMap', await stored(layer)))
    near(ours, await middle())
    quiet()
  })
}

test('irradiance on a rough white surface is E / pi less the reflection', async () => {
  const material = { pbrMetallicRoughness: { roughnessFactor: 1, metallicFactor: 0 } }
  const layer = irradiance([3, 3, 3])
  await load(square({ layers: [layer], material: { ...material, extensions: { KHR_materials_unlit: {} } } }))
  near(await middle(), (await stored(layer)).map((e) => e / Math.PI))
  await load(square({ layers: [layer], material }))
  const [r] = await middle()
  assert.ok(r > 0.9 * 3 / Math.PI && r < 3 / Math.PI, `${r}`)
  quiet()
})

test('irradiance is not dimmed by the occlusion beside it', async () => {
  const layer = irradiance([0.2, 1.5, 7])
  await load(square({ layers: [occlusion(0.1), layer] }))
  const both = await middle()
  await load(square({ layers: [layer] }))
  near(both, await middle())
  quiet()
})

test('harmonics are irradiance for the normal of the pixel, also when the model is turned', async () => {
  const coefficients = [[2, 3, 1], [0.5, 0.2, 0.1], [0.9, 0.4, 0.6], [0.3, 0.7, 0.2], [0.1, 0.2, 0.3], [0.4, 0, 0.1], [0.3, 0.6, 0.2],
    [0.2, 0.1, 0.5], [0.6, 0.3, 0.1]]
  const layer = (c, k) => ({ signal: `irradianceSh${k}`, channels: 3, range: [0, 4], codes: four(rgbCode(c.map((x) => x / 4))) })
  for (const count of [1, 4, 9]) {
    const layers = coefficients.slice(0, count).map(layer)
    const c = await Promise.all(layers.map(stored))
    // At the normal (0, 0, 1).
    const basis = [0.28209479177387814, 0, 0.4886025119029199, 0, 0, 0, 2 * 0.31539156525252005, 0, 0]
    const e = [0, 1, 2].map((k) => c.reduce((sum, rgb, i) => sum + rgb[k] * basis[i], 0))
    for (const turn of ['', 'gltf.scene.rotation.set(0.4, 0.5, 2); gltf.scene.scale.setScalar(3)']) {
      await load(square({ layers, material: MATERIALS.MeshStandardMaterial }))
      await change(turn)
      const ours = await middle()
      await load(square({ layers: [irradiance([1, 1, 1])], material: MATERIALS.MeshStandardMaterial, fallback: false }), { plugin: false })
      await change(turn + constantMap('lightMap', e))
      near(ours, await middle(), 1e-4)
    }
  }
  quiet()
})

test('direct and indirect add up, unless their sum is there', async () => {
  const [a, b] = [irradiance([1, 2, 3]), irradiance([2, 1, 0.5])]
  const material = MATERIALS.MeshBasicMaterial
  await load(square({ layers: [{ ...a, signal: 'direct' }, { ...b, signal: 'indirect' }], material }))
  const [x, y] = [await stored(a), await stored(b)]
  near(await middle(), x.map((e, k) => ((e + y[k]) / Math.PI) * [0.8, 0.5, 0.3][k]))
  await load(square({ layers: [{ ...a, signal: 'direct' }, b], material }))
  near(await middle(), y.map((e, k) => (e / Math.PI) * [0.8, 0.5, 0.3][k]))
  quiet()
})

test('shadow dims direct light, and only when it is asked for', async () => {
  const layers = [occlusion(1), { signal: 'shadow', codes: four(scalarCode(0.25)) }]
  const bytes = square({ layers, material: PHYSICAL, fallback: false })
  const sun = (intensity) => `const sun = new THREE.DirectionalLight(0xffddaa, ${intensity}); sun.position.set(1, 2, 3)
    scene.add(sun, new THREE.AmbientLight(0x88ccff, 0.7))`
  const pictures = []
  for (const [options, intensity] of [[{}, 2], [{ plugin: false }, 2], [{ roles: { shadow: 'shadow' } }, 2], [{}, 0.5]]) {
    await load(bytes, options)
    await change(sun(intensity))
    pictures.push(await middle())
  }
  near(pictures[0], pictures[1])
  near(pictures[2], pictures[3], 1e-4)
  assert.ok(pictures[2][0] < 0.9 * pictures[0][0])
  quiet()
})

test('intensities change while running', async () => {
  await load(square({ layers: [occlusion(0.2), irradiance([1, 1, 1])], material: MATERIALS.MeshBasicMaterial }))
  const [r] = await middle()
  await change('gltf.userData.lightkiln.irradianceIntensity = 3')
  near([(await middle())[0]], [3 * r])
  await load(square({ layers: [occlusion(0.2)], material: MATERIALS.MeshBasicMaterial }), { occlusionIntensity: 0.5 })
  near(await middle(), [0.8, 0.5, 0.3].map((x) => x * 0.6))
  quiet()
})

test('the fallback is off and the colors of the asset are back', async () => {
  const material = MATERIALS.MeshBasicMaterial
  await load(square({ layers: [occlusion(1)], material, colors: [0, 0, 0] }))
  near(await middle(), [0.8, 0.5, 0.3])
  await load(square({ layers: [occlusion(1)], material, colors: [0, 0, 0], color0: [0.5, 1, 0.25] }))
  near(await middle(), [0.4, 0.5, 0.075])
  await load(square({ layers: [occlusion(1)], material, colors: [0.5, 0.5, 0.5] }), { plugin: false })
  near(await middle(), [0.4, 0.25, 0.15])
  quiet()
})

test('pages are layers of one array', async () => {
  const page = (value) => ({ width: 8, height: 4, channels: 1, bits: 8, data: new Uint8Array(32).fill(value) })
  for (const [number, expected] of [[0, 51], [1, 102], [2, 204]]) {
    const place = (u, v) => [u * 8, (v + 4 * number) * 8]
    const codes = [place(1, 1), place(7, 1), place(7, 3), place(1, 3)]
    const layer = { signal: 'ambientOcclusion', codes, pages: [page(51), page(102), page(204)] }
    await load(square({ layers: [layer], pageSize: [8, 4] }))
    await view('ambientOcclusion')
    near(await middle(), [expected / 255, expected / 255, expected / 255])
  }
  quiet()
})

test('shader additions of others are kept, and told apart', async () => {
  await load(square({ layers: [occlusion(0.5)], material: MATERIALS.MeshBasicMaterial }))
  await change(`
    const [first] = materials
    const second = first.clone()
    const tint = (color) => (shader) => {
      shader.fragmentShader = shader.fragmentShader.replace('#include <dithering_fragment>',
        '#include <dithering_fragment>\\n gl_FragColor.rgb *= ' + color + ';')
    }
    const mesh = gltf.scene.children[0].isMesh ? gltf.scene.children[0] : gltf.scene.children[0].children[0]
    const other = mesh.clone()
    other.position.x = 1
    scene.add(other)
    other.material = second
    second.onBeforeCompile = tint('vec3(0.0, 1.0, 0.0)')
    second.customProgramCacheKey = () => 'green'
    first.onBeforeCompile = tint('vec3(1.0, 0.0, 0.0)')
    first.customProgramCacheKey = () => 'red'
    gltf.userData.lightkiln.apply(mesh)
    gltf.userData.lightkiln.apply(other)
    other.position.z = -0.5
    other.position.x = 1.2
  `)
  const shown = await pixels()
  const at = (x) => [...shown.slice((128 * 256 + x) * 4, (128 * 256 + x) * 4 + 3)]
  near(at(64), [0.4, 0, 0])
  near(at(250), [0.4, 0, 0])
  await change('scene.children[0].visible = false')
  const behind = await pixels()
  near([...behind.slice((128 * 256 + 250) * 4, (128 * 256 + 250) * 4 + 3)], [0, 0.25, 0])
  quiet()
})

test('a material shared with a primitive without light is copied', async () => {
  const file = readGlb(square({ layers: [occlusion(0.5)], material: MATERIALS.MeshBasicMaterial, fallback: false }))
  const [{ primitives }] = file.json.meshes
  const { _LIGHTUV, ...attributes } = primitives[0].attributes
  primitives.push({ attributes, indices: primitives[0].indices, material: 0 })
  file.json.meshes.push({ primitives: [primitives.pop()] })
  file.json.nodes.push({ mesh: 1, translation: [1, 0, 1] })
  file.json.scenes[0].nodes.push(1)
  assert.equal((await load(writeGlb(file))).materials.length, 2)
  const shown = await pixels()
  const at = (x) => [...shown.slice((128 * 256 + x) * 4, (128 * 256 + x) * 4 + 3)]
  near(at(64), [0.4, 0.25, 0.15])
  near(at(192), [0.8, 0.5, 0.3])
  quiet()
})

test('instances have the light of their mesh', async () => {
  await load(square({ layers: [occlusion(0.5)], material: MATERIALS.MeshBasicMaterial }))
  await change(`
    const mesh = gltf.scene.children[0].isMesh ? gltf.scene.children[0] : gltf.scene.children[0].children[0]
    const instances = new THREE.InstancedMesh(mesh.geometry, mesh.material, 2)
    instances.setMatrixAt(0, new THREE.Matrix4().makeTranslation(-0.5, 0, 0).scale(new THREE.Vector3(0.3, 0.3, 1)))
    instances.setMatrixAt(1, new THREE.Matrix4().makeTranslation(0.5, 0, 0).scale(new THREE.Vector3(0.3, 0.3, 1)))
    scene.remove(gltf.scene)
    scene.add(instances)
  `)
  const shown = await pixels()
  const at = (x) => [...shown.slice((128 * 256 + x) * 4, (128 * 256 + x) * 4 + 3)]
  near(at(57), [0.4, 0.25, 0.15])
  near(at(199), [0.4, 0.25, 0.15])
  near(at(128), [0, 0, 0])
  quiet()
})

test('a file that cannot be read shows its fallback and says why', async () => {
  const material = MATERIALS.MeshBasicMaterial
  const broken = readGlb(square({ layers: [occlusion(1)], material, colors: [0.5, 0.5, 0.5] }))
  broken.json.extensions[EXTENSION].layers[0].pages = [addTexture(broken, new Uint8Array([1, 2, 3]))]
  const old = readGlb(square({ layers: [occlusion(1)], material, colors: [0.5, 0.5, 0.5] }))
  old.json.extensions[EXTENSION].version = 1
  const unknown = readGlb(square({ layers: [{ ...occlusion(1), signal: 'unheardOf' }], material, colors: [0.5, 0.5, 0.5] }))
  for (const file of [broken, old, unknown]) {
    assert.equal((await load(writeGlb(file))).lit, false)
    near(await middle(), [0.4, 0.25, 0.15])
    const [complaint, ...others] = complaints.splice(0)
    assert.match(complaint, /three-lightkiln: the fallback is shown: /)
    assert.deepEqual(others, [])
  }
})

test('a .gltf with its pages beside it is as the .glb', async () => {
  const bytes = baked('contact')
  const camera = cameraFor((await readScene(bytes)).triangles, VIEWS[0])
  await load(bytes)
  await change('scene.add(new THREE.AmbientLight(0xffffff, 3))')
  const expected = await pixels(camera)
  const file = readGlb(bytes)
  file.json.extensions[EXTENSION].layers[0].pages.forEach((texture, page) => {
    browser.files.set(`page ${page}.png`, imageBytes(file, texture))
    const { source } = file.json.textures[texture]
    file.json.images[source] = { uri: encodeURIComponent(`page ${page}.png`) }
  })
  file.json.buffers[0].uri = 'file.bin'
  browser.files.set('file.bin', file.bin)
  browser.files.set('file.gltf', new TextEncoder().encode(JSON.stringify(file.json)))
  assert.ok((await page.evaluate(() => tests.load('/files/file.gltf'))).lit)
  await change('scene.add(new THREE.AmbientLight(0xffffff, 3))')
  assert.deepEqual(await pixels(camera), expected)
  quiet()
})
