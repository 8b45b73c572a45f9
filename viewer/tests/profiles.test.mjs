// The profiles `stock` and `lightmap` in three.js and Babylon.js without any plugin of ours: what their materials show is
// what a lookup of the file says, and about what the profile `eta` shows with the plugin; also after gltfpack and
// gltf-transform.

import assert from 'node:assert/strict'
import { execFile } from 'node:child_process'
import { mkdtemp, readFile, rm, writeFile } from 'node:fs/promises'
import { tmpdir } from 'node:os'
import { join } from 'node:path'
import { after, before, test } from 'node:test'
import { fileURLToPath } from 'node:url'
import { promisify } from 'node:util'
import { floats, startBrowser } from './browser.mjs'
import { readOcclusion } from './occlusion.mjs'
import { profileFiles } from './profiles.mjs'
import { VIEWS, cameraFor, compare, visible } from './raster.mjs'
import { readScene } from './scene.mjs'

const STEP = 1 / 255
const BIN = fileURLToPath(new URL('../node_modules/.bin', import.meta.url))
const run = promisify(execFile)

/** Stock has the charts and the vertex values of eta; a full lightmap has texels where eta has none, and both err. */
const PROFILES_RMSE = { stock: 0.003, lightmap: 0.02 }
/** Of texture coordinates of 16 bits, and of 12. */
const TOOLS_RMSE = { fine: 0.002, coarse: 0.01 }

let browser, three, babylon

before(async () => {
  browser = await startBrowser()
  three = await browser.open('/tests/pages/three.html')
  babylon = await browser.open('/tests/pages/babylon.html')
})
after(() => browser.close())

const quiet = ({ complaints }) => assert.deepEqual(complaints.splice(0), [])

/** White, rough, without anything of its own, under light from everywhere: nothing but the occlusion is left. */
const ONLY_LIGHT = {
  three: `
    for (const m of materials) {
      for (const map of ['map', 'normalMap', 'roughnessMap', 'metalnessMap', 'emissiveMap']) m[map] = null
      m.color.set(0xffffff)
      Object.assign(m, { metalness: 0, roughness: 1, side: THREE.DoubleSide, transparent: false, alphaTest: 0, depthWrite: true,
        depthTest: true, blending: THREE.NoBlending, needsUpdate: true })
      m.emissive.set(0)
    }
    scene.add(new THREE.AmbientLight(0xffffff, Math.PI))`,
  babylon: `
    scene.ambientColor = new Color3(1, 1, 1)
    for (const m of scene.materials) {
      for (const map of ['albedoTexture', 'bumpTexture', 'metallicTexture', 'emissiveTexture']) m[map] = null
      m.albedoColor = m.ambientColor = new Color3(1, 1, 1)
      m.emissiveColor = new Color3(0, 0, 0)
      // The filter of four places that Babylon has by itself, seen from the side, is more than a lookup.
      if (m.ambientTexture) m.ambientTexture.anisotropicFilteringLevel = 1
      Object.assign(m, { metallic: 0, roughness: 1, backFaceCulling: false, transparencyMode: Material.MATERIAL_OPAQUE })
    }`,
}

/** The same without the occlusion: what its share is taken of. */
const BARE = {
  three: 'materials.forEach((m) => { m.aoMap = null; m.needsUpdate = true })',
  babylon: 'scene.materials.forEach((m) => { m.ambientTexture = null })',
}

async function show({ page }, engine, bytes, plugin) {
  browser.files.set('file.glb', bytes)
  await page.evaluate((plugin) => tests.load('/files/file.glb', { plugin }), plugin)
  await page.evaluate((code) => tests.change(code), ONLY_LIGHT[engine])
  return async (camera) => floats(await page.evaluate((camera) => tests.pixels(camera), camera))
}

/** Babylon writes its pictures in 8 bits of a gamma of 2.2: two of them are worth about three steps of light. */
const FROM_SCREEN = { three: (x) => x, babylon: (x) => x ** 2.2 }
const BOUND = { three: STEP, babylon: 3 * STEP }

/** Every certain pixel is what the file says. */
async function assertShown(engine, bytes, t, name, plugin = false) {
  const { triangles, layer } = await readOcclusion(bytes)
  assert.ok(triangles.every(({ codes }) => codes !== null), 'every material shows the light')
  const viewer = engine === 'three' ? three : babylon
  const shown = await show(viewer, engine, bytes, plugin)
  const cameras = VIEWS.map((toward) => cameraFor(triangles, toward))
  const pictures = []
  for (const camera of cameras) pictures.push(await shown(camera))
  await viewer.page.evaluate((code) => tests.change(code), BARE[engine])
  let [worst, total] = [0, 0]
  for (const [number, camera] of cameras.entries()) {
    const bare = await shown(camera)
    const shares = pictures[number].map((x, i) => FROM_SCREEN[engine](x / bare[i]))
    const { largest, over, compared } = compare(visible(triangles, camera), layer, shares, BOUND[engine])
    assert.ok(compared > 1000, `only ${compared} pixels to compare`)
    assert.equal(over, 0, `${over} of ${compared} pixels are off, by up to ${largest}`)
    worst = Math.max(worst, largest)
    total += compared
  }
  t.diagnostic(`${name} in ${engine}: ${total} pixels, off by ${worst.toFixed(5)} at most`)
  quiet(viewer)
}

/** Root mean square and largest difference of two pictures of three, over pixels that are certain. */
async function difference(a, b, triangles) {
  let [sum, largest, count] = [0, 0, 0]
  for (const toward of VIEWS) {
    const camera = cameraFor(triangles, toward)
    const clear = visible(triangles, camera)
    const pictures = []
    for (const { bytes, plugin } of [a, b]) pictures.push(await (await show(three, 'three', bytes, plugin))(camera))
    for (const { x, y } of clear) {
      const error = Math.abs(pictures[0][(y * 256 + x) * 4] - pictures[1][(y * 256 + x) * 4])
      sum += error * error
      largest = Math.max(largest, error)
      count++
    }
  }
  return { rmse: Math.sqrt(sum / count), largest, count }
}

for (const { name, ...files } of profileFiles) {
  for (const engine of ['three', 'babylon']) {
    for (const profile of ['stock', 'lightmap']) {
      test(`${profile} of ${name} in ${engine} is what the file says`, async (t) => {
        await assertShown(engine, files[profile], t, `${profile} of ${name}`)
      })
    }
  }

  test(`our plugin leaves stock of ${name} to its materials`, async (t) => {
    await assertShown('three', files.stock, t, `stock of ${name}, plugin registered`, true)
    await assertShown('babylon', files.stock, t, `stock of ${name}, plugin registered`, true)
  })

  test(`texcoord of ${name} shows what eta shows`, async (t) => {
    const { triangles, layers: [layer] } = await readScene(files.eta)
    for (const [engine, { page, ...rest }] of [['three', three], ['babylon', babylon]]) {
      browser.files.set('file.glb', files.texcoord)
      assert.ok((await page.evaluate(() => tests.load('/files/file.glb'))).lit)
      await page.evaluate((signal) => tests.view(signal), layer.signal)
      for (const toward of VIEWS) {
        const camera = cameraFor(triangles, toward)
        const shown = floats(await page.evaluate((camera) => tests.pixels(camera), camera))
        const { largest, over, compared } = compare(visible(triangles, camera), layer, shown, STEP)
        assert.ok(compared > 1000, `only ${compared} pixels to compare`)
        assert.equal(over, 0, `${engine}: ${over} of ${compared} pixels are off, by up to ${largest}`)
        t.diagnostic(`texcoord of ${name} in ${engine}: ${compared} pixels, off by ${largest.toFixed(5)} at most`)
      }
      quiet(rest)
    }
  })

  test(`stock and lightmap of ${name} look like eta`, async (t) => {
    const eta = { bytes: files.eta, plugin: true }
    for (const profile of ['stock', 'lightmap']) {
      const { triangles } = await readOcclusion(files[profile])
      const { rmse, largest, count } = await difference(eta, { bytes: files[profile], plugin: false }, triangles)
      t.diagnostic(`${profile} of ${name} against eta: RMSE ${rmse.toFixed(4)}, largest ${largest.toFixed(3)}, ${count} pixels`)
      assert.ok(rmse < PROFILES_RMSE[profile], `${profile}: ${rmse}`)
    }
    quiet(three)
  })

  test(`stock of ${name} is shown after gltfpack and gltf-transform`, async (t) => {
    const folder = await mkdtemp(join(tmpdir(), 'lightkiln-'))
    t.after(() => rm(folder, { recursive: true }))
    const [input, output] = [join(folder, 'in.glb'), join(folder, 'out.glb')]
    await writeFile(input, files.stock)
    const optimize = ['optimize', input, output, '--texture-compress', 'false', '--simplify', 'false', '--palette', 'false']
    const tools = [
      ['gltfpack -vt 16', 'gltfpack', ['-i', input, '-o', output, '-vt', '16', '-vp', '16'], TOOLS_RMSE.fine],
      ['gltfpack -c', 'gltfpack', ['-i', input, '-o', output, '-c', '-vp', '16'], TOOLS_RMSE.coarse],
      ['gltf-transform optimize', 'gltf-transform', optimize, TOOLS_RMSE.coarse],
      ['gltf-transform optimize --compress false', 'gltf-transform', [...optimize, '--compress', 'false'], TOOLS_RMSE.fine],
    ]
    const { triangles } = await readOcclusion(files.stock)
    for (const [tool, program, options, bound] of tools) {
      await t.test(tool, async (t) => {
        await run(join(BIN, program), options)
        const bytes = new Uint8Array(await readFile(output))
        for (const engine of ['three', 'babylon']) await assertShown(engine, bytes, t, tool)
        const { rmse, largest } = await difference({ bytes: files.stock, plugin: false }, { bytes, plugin: false }, triangles)
        t.diagnostic(`${tool}: RMSE ${rmse.toFixed(5)}, largest ${largest.toFixed(3)} from before`)
        assert.ok(rmse < bound, `${rmse}`)
      })
    }
  })
}
