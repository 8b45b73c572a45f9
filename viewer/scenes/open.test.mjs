// Every file of a folder of baked scenes, in three.js, in Babylon.js and in the page of `lightkiln view`: its light is
// loaded, nothing complains (a WebGL warning is a complaint), and the picture shows something.
//
// LIGHTKILN_FILES names the folder; LIGHTKILN the program.

import assert from 'node:assert/strict'
import { existsSync } from 'node:fs'
import { join } from 'node:path'
import { after, before, test } from 'node:test'
import { PROGRAM, pixelsOf, serve } from '../../crates/page/browser/browser.mjs'
import { FOLDER, bakedFiles } from '../tests/baked.mjs'
import { floats, startBrowser } from '../tests/browser.mjs'
import { VIEWS, cameraFor } from '../tests/raster.mjs'

let browser
before(async () => {
  assert.ok(existsSync(PROGRAM), `${PROGRAM} is not there: run make build`)
  browser = await startBrowser()
})
after(() => browser.close())

/** A camera for a box of two corners. */
const around = (box) => cameraFor([{ corners: box }], VIEWS[0])

/** Numbers of RGBA pixels, white being 1: most of the picture is the scene, and the scene is not black and not one color. */
function assertShows(pixels, white) {
  const levels = new Set()
  let bright = 0
  for (let i = 0; i < pixels.length; i += 4) {
    const level = Math.max(pixels[i], pixels[i + 1], pixels[i + 2]) / white
    levels.add(Math.round(level * 255))
    if (level > 0.05) bright++
  }
  assert.ok(bright > pixels.length / 4 / 50, `${bright} of ${pixels.length / 4} pixels are not black`)
  assert.ok(levels.size > 20, `${levels.size} levels`)
}

const ENGINES = {
  'three.js': {
    page: '/tests/pages/three.html',
    setUp: `scene.add(new THREE.AmbientLight(0xffffff, 2), new THREE.DirectionalLight(0xffffff, 2))
      const box = new THREE.Box3().setFromObject(gltf.scene)
      return [box.min.toArray(), box.max.toArray()]`,
    picture: (page, camera) => page.evaluate((camera) => tests.canvas(camera), camera),
    white: 255,
  },
  'Babylon.js': {
    page: '/tests/pages/babylon.html',
    setUp: `new DirectionalLight('sun', new Vector3(-0.3, -0.8, -0.5), scene)
      scene.ambientColor = new Color3(1, 1, 1)
      scene.materials.forEach((material) => { material.ambientColor = new Color3(1, 1, 1) })
      const { min, max } = scene.getWorldExtends()
      return [min.asArray(), max.asArray()]`,
    picture: (page, camera) => page.evaluate((camera) => tests.pixels(camera), camera),
    white: 1,
  },
}

for (const [engine, { page: path, setUp, picture, white }] of Object.entries(ENGINES)) {
  let opened
  for (const { name, bytes } of bakedFiles) {
    test(`${name} opens in ${engine}`, async () => {
      const { page, complaints } = (opened ??= await browser.open(path))
      browser.files.set('file.glb', bytes)
      assert.ok((await page.evaluate(() => tests.load('/files/file.glb', { irradianceIntensity: 0.001 }))).lit, complaints.join('\n'))
      const box = await page.evaluate((code) => tests.change(code), setUp)
      assertShows(floats(await picture(page, around(box))), white)
      assert.deepEqual(complaints.splice(0), [])
    })
  }
}

/** Bytes of the page's files that a model takes, without pictures of its surfaces. */
async function bytesOf(url) {
  const about = await (await fetch(new URL('model.json', url))).text()
  const blocks = JSON.parse(about).blocks.map(async (name) => (await (await fetch(new URL(name, url))).arrayBuffer()).byteLength)
  return (await Promise.all(blocks)).reduce((sum, bytes) => sum + bytes, about.length)
}

for (const { name, bytes: { length } } of bakedFiles) {
  test(`${name} opens in lightkiln view`, async (t) => {
    const began = performance.now()
    const { url, stop } = await serve([join(FOLDER, `${name}.glb`)])
    try {
      const served = performance.now()
      const { page, complaints } = await browser.open(url, { width: 512, height: 512 })
      const opened = performance.now()
      const pixels = await pixelsOf(page, { left: 'hybrid', divider: 1 })
      const triangles = await page.evaluate(() => globalThis.lightkiln.model.indices.length / 3)
      await page.close()
      assertShows(pixels, 255)
      assert.deepEqual(complaints, [])
      const mib = (bytes) => (bytes / 2 ** 20).toFixed(1)
      const seconds = (ms) => (ms / 1000).toFixed(2)
      t.diagnostic(`| ${name} | ${triangles} | ${mib(length)} | ${mib(await bytesOf(url))} | ${seconds(served - began)} | ${seconds(opened - served)} |`)
    } finally {
      stop()
    }
  })
}
