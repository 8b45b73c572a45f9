// What showing light costs: frame times of the same triangles with the light of a baked file in several ways, in one run.
//
//   node frame-times.mjs FILE.glb ... [--rounds 60]
//
// Prints a table in Markdown: drawing light alone, and a physical material of three.js that the light dims. Ways take turns in
// each round, and ratios are medians of those of all rounds, so that what else the machine does meets all of them alike. Times
// are those of the GPU's clock where it has one; of a software renderer, the processor time that the browser's GPU process took.

import { readFileSync } from 'node:fs'
import { basename } from 'node:path'
import { fileURLToPath } from 'node:url'
import { SUBTEXELS, isColor, readExtension, readPng } from 'lightkiln-format'
import { startBrowser } from '../tests/browser.mjs'
import { imageBytes, readGlb } from '../tests/glb.mjs'
import { VIEWS, cameraFor } from '../tests/raster.mjs'
import { readScene } from '../tests/scene.mjs'

/** Share of a full lightmap that charts fill; packers manage about half. */
const FILL = 0.5

const minus = (a, b) => a.map((x, k) => x - b[k])
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
const median = (numbers) => numbers.toSorted((a, b) => a - b)[numbers.length >> 1]

/** Texels along a metre of the texture triangles: the middle one. */
function densityOf(triangles) {
  const rates = triangles.filter(({ codes: [codes] }) => !codes.some(isColor)).map(({ corners, codes: [codes] }) => {
    const texels = Math.hypot(...[0, 1].map((k) => (codes[1][k] - codes[0][k]) / SUBTEXELS))
    return texels / Math.hypot(...minus(corners[1], corners[0]))
  })
  return median(rates.filter((rate) => rate > 0 && Number.isFinite(rate)))
}

/** An indexed mesh whose vertices are told apart by position and attribute. */
function indexed(triangles, attributeOf) {
  const [positions, attributes, numbers] = [[], [], new Map()]
  const indices = triangles.flatMap((triangle) => [0, 1, 2].map((k) => {
    const [position, attribute] = [triangle.corners[k], attributeOf(triangle, k)]
    const key = [...position, ...attribute].join()
    if (!numbers.has(key)) {
      numbers.set(key, numbers.size)
      positions.push(...position)
      attributes.push(...attribute)
    }
    return numbers.get(key)
  }))
  return { vertices: numbers.size, indices: Uint32Array.from(indices), positions: Float32Array.from(positions), attributes }
}

/** The same triangles with codes, and with texture coordinates of a full lightmap of equal density. */
async function readMeshes(bytes) {
  const file = readGlb(bytes)
  const { pageSize, layers: [layer] } = readExtension(file.json)
  if (layer.channels !== 1) throw new Error('the first layer must have one channel')
  const triangles = (await readScene(bytes)).triangles.filter(({ codes }) => codes !== null)
  const density = densityOf(triangles)
  const area = triangles.reduce((sum, { corners: [a, b, c] }) => sum + Math.hypot(...cross(minus(b, a), minus(c, a))) / 2, 0)
  const side = Math.ceil(Math.sqrt((area * density ** 2) / FILL))
  const hybrid = indexed(triangles, ({ codes }, k) => codes[0][k])
  // Charts as good as they can be: each a side of the box around things, wrapped around the texture, so that neighbours are
  // neighbours in it and few vertices are split.
  const lightmap = indexed(triangles, ({ corners }, k) => {
    const normal = cross(minus(corners[1], corners[0]), minus(corners[2], corners[0])).map(Math.abs)
    const axis = normal.indexOf(Math.max(...normal))
    return [...corners[k].toSpliced(axis, 1).map((x) => (x * density) / side), axis]
  })
  const pages = await Promise.all(layer.pages.map((texture) => readPng(imageBytes(file, texture))))
  const eightBits = ({ data, bits }) => (bits === 16 ? Uint8Array.from(data, (x) => x >> 8) : data)
  return {
    triangles, side, pageSize, pages: pages.map(eightBits), hybrid: { ...hybrid, attributes: Uint16Array.from(hybrid.attributes) },
    lightmap: { ...lightmap, attributes: Float32Array.from(lightmap.attributes).filter((_, i) => i % 3 < 2) },
  }
}

/** Clip from world, column by column, of a camera of `cameraFor` as a pinhole with an opening of 28 degrees. */
function clipFromWorld({ right, up, toward, center, half }, aspect) {
  const [near, far, tangent] = [half, 20 * half, 0.25]
  const eye = center.map((x, k) => x + (toward[k] * half) / tangent)
  const rows = [right.map((x) => x / (tangent * aspect)), up.map((x) => x / tangent), toward, toward.map((x) => -x)]
  const along = (row) => row.reduce((sum, x, k) => sum - x * eye[k], 0)
  const [x, y, z, w] = rows.map((row) => [...row, along(row)])
  const depth = z.map((value) => (-value * (far + near)) / (far - near))
  depth[3] -= (2 * far * near) / (far - near)
  return [0, 1, 2, 3].flatMap((k) => [x[k], y[k], -depth[k], w[k]])
}

const files = process.argv.slice(2)
const option = files.indexOf('--rounds')
const rounds = option < 0 ? 60 : Number(files.splice(option, 2)[1])
if (files.length === 0 || !(rounds > 0)) {
  console.error('usage: frame-times.mjs FILE.glb ... [--rounds 60]')
  process.exit(1)
}

const { browser, files: served, open, close } = await startBrowser({ root: fileURLToPath(new URL('../..', import.meta.url)) })
const session = await browser.newBrowserCDPSession()

/** Seconds of all cores that drawing has taken. */
async function processorTime() {
  const { processInfo } = await session.send('SystemInfo.getProcessInfo')
  return processInfo.find(({ type }) => type === 'GPU').cpuTime
}

/** Milliseconds of each way, a number per round. */
async function takeTimes(page, { names, renderer }) {
  const isSoftware = /swiftshader|llvmpipe|warp/i.test(renderer)
  const frames = async (name, repeats) => {
    const before = await processorTime()
    const passed = await page.evaluate(([name, repeats]) => globalThis.frames(name, repeats), [name, repeats])
    return (isSoftware ? 1000 * (await processorTime() - before) : passed) / repeats / VIEWS.length
  }
  // The first of each way compiles; then as often as it takes to be long for the clock.
  const times = {}
  const repeats = {}
  for (const name of names) {
    await frames(name, 1)
    repeats[name] = Math.max(1, Math.ceil((isSoftware ? 200 : 20) / VIEWS.length / (await frames(name, 1))))
    times[name] = []
  }
  for (let round = 0; round < rounds; round++) {
    for (let i = 0; i < names.length; i++) {
      const name = names[(round + i) % names.length]
      times[name].push(await frames(name, repeats[name]))
    }
  }
  return { times, about: `${renderer}, ${isSoftware ? 'processor time of drawing' : "time by the GPU's clock, or by that of the page"}` }
}

try {
  const rows = []
  let about
  for (const path of files) {
    const meshes = await readMeshes(new Uint8Array(readFileSync(path)))
    for (const name of ['hybrid', 'lightmap']) {
      for (const part of ['positions', 'attributes', 'indices']) served.set(`${name}.${part}`, Buffer.from(meshes[name][part].buffer))
    }
    meshes.pages.forEach((page, i) => served.set(`page.${i}`, Buffer.from(page)))
    const { page, complaints } = await open('/viewer/scenes/frame-times.html')
    const cameras = VIEWS.map((view) => clipFromWorld(cameraFor(meshes.triangles, view), 1920 / 1080))
    const { side, pageSize, pages } = meshes
    const prepared = await page.evaluate((job) => globalThis.prepare(job), { side, pageSize, pages: pages.length, cameras })
    const taken = await takeTimes(page, prepared)
    await page.close()
    if (complaints.length > 0) throw new Error(complaints.join('\n'))
    about = taken.about
    const ms = (name) => median(taken.times[name]).toFixed(1)
    const pair = (a, b) => [ms(a), ms(b), median(taken.times[b].map((time, i) => time / taken.times[a][i])).toFixed(2)]
    rows.push([basename(path, '.glb').replace('.baked', ''), meshes.triangles.length, `${meshes.hybrid.vertices} / ${meshes.lightmap.vertices}`,
      `${(100 * prepared.textured).toFixed(0)} %`, ms('nothing'), ms('vertices'), ...pair('lightmap', 'hybrid'),
      ...pair('lightmap, levels', 'hybrid, levels'), ...pair('material, lightmap', 'material, hybrid')])
    console.error(rows.at(-1).join('  '))
  }
  console.log(`${about}; 1920 x 1080, no multisampling, ${VIEWS.length} views, ${rounds} rounds; medians in ms\n`)
  const head = ['scene', 'triangles', 'vertices: hybrid / lightmap', 'pixels with texels', 'no light', 'vertices', 'lightmap', 'hybrid', 'ratio',
    'lightmap, mip levels', 'hybrid, mip levels', 'ratio', 'in a material: lightmap', 'hybrid', 'ratio']
  for (const row of [head, head.map((_, i) => (i === 0 ? '---' : '---:')), ...rows]) console.log(`| ${row.join(' | ')} |`)
} finally {
  await close()
}
