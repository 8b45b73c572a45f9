// What showing light costs: frame times of the same triangles with the light of a baked file and with a full lightmap, in one run.
//
//   node frame-times.mjs HYBRID.glb=LIGHTMAP.glb ... [--rounds 40] [--angle default] [--levels 0]
//
// `--angle` is what the browser draws with, as ANGLE calls it: the GPU where it has one (default), swiftshader, gl-egl (Mesa), ...
// The two files are bakes of one scene, the second with `--profile lightmap`. Prints tables in Markdown: drawing light alone, and a
// physical material of three.js that the light dims, with `--levels 1` light alone with mip levels, too; and, of the first pair,
// pictures that are filled once, by texels or by vertex values.
//
// What is compared takes turns in each round (a, b, b, a), so that what else the machine does meets both alike. A ratio is the median
// of those of all rounds, and the interval beside it holds the true median with 95 % certainty, whatever the noise is like: its ends are
// the rounds that a fair coin's number of heads would leave outside with 2.5 % on either side. Times are those of the GPU's clock where it has one; of a
// software renderer, the processor time that the browser's GPU process took.

import { existsSync, readFileSync, readdirSync } from 'node:fs'
import { basename } from 'node:path'
import { fileURLToPath } from 'node:url'
import { EXTENSION, readExtension, readPng } from 'lightkiln-format'
import { startBrowser } from '../tests/browser.mjs'
import { imageBytes, readGlb } from '../tests/glb.mjs'
import { readOcclusion } from '../tests/occlusion.mjs'
import { VIEWS, cameraFor } from '../tests/raster.mjs'
import { readScene } from '../tests/scene.mjs'

const median = (numbers) => numbers.toSorted((a, b) => a - b)[numbers.length >> 1]

/** What is compared: a lightmap, and our way. */
const PAIRS = [
  ['lightmap', 'hybrid'], ['lightmap, levels', 'hybrid, levels'], ['material, lightmap', 'material, hybrid'],
  ['fill, lightmap', 'fill, texels'], ['fill, lightmap again', 'fill, colors'],
]

/** Ends of the interval that holds the median with 95 % certainty; of few numbers, the first and the last. */
function medianInterval(numbers) {
  const sorted = numbers.toSorted((a, b) => a - b)
  const { length } = sorted
  let outside = 0
  let tail = 0.5 ** length
  for (let chance = tail; tail <= 0.025; tail += chance) {
    outside++
    chance *= (length - outside + 1) / outside
  }
  const first = Math.max(0, outside - 1)
  return [sorted[first], sorted[length - 1 - first]]
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

/** The same triangles with codes, and with the texture coordinates of a lightmap; each with its pages. */
async function readMeshes(hybridBytes, lightmapBytes) {
  const [hybrid, lightmap] = [readGlb(hybridBytes), readGlb(lightmapBytes)]
  const { pageSize, layers: [layer] } = readExtension(hybrid.json)
  const full = lightmap.json.extensions[EXTENSION]
  if (full.profile !== 'lightmap') throw new Error(`a bake of the profile ${full.profile}, not lightmap`)
  if (layer.channels !== 1 || full.layers[0].signal !== layer.signal) throw new Error('the first layers must be one signal of one channel')
  const lit = ({ codes }) => codes !== null
  const triangles = (await readScene(hybridBytes)).triangles.filter(lit)
  const mapped = (await readOcclusion(lightmapBytes)).triangles.filter(lit)
  if (mapped.length !== triangles.length) throw new Error(`${triangles.length} triangles with light, ${mapped.length} in the lightmap`)
  const page = async (file, texture) => {
    const { data, bits } = await readPng(imageBytes(file, texture))
    return bits === 16 ? Uint8Array.from(data, (x) => x >> 8) : data
  }
  const shorts = ({ attributes, ...mesh }) => ({ ...mesh, attributes: Uint16Array.from(attributes) })
  return {
    triangles,
    hybrid: { ...shorts(indexed(triangles, ({ codes }, k) => codes[0][k])), size: pageSize, pages: await Promise.all(layer.pages.map((texture) => page(hybrid, texture))) },
    lightmap: {
      ...shorts(indexed(mapped, ({ codes }, k) => codes[k].map((x) => Math.round(65535 * x)))), size: full.pageSize,
      pages: [await page(lightmap, full.layers[0].pages[0])],
    },
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
const option = (name, fallback) => {
  const at = files.indexOf(name)
  return at < 0 ? fallback : files.splice(at, 2)[1]
}
const rounds = Number(option('--rounds', 40))
const withLevels = option('--levels', '0') === '1'
const angle = option('--angle', 'default')
const pairs = files.map((pair) => pair.split('='))
if (pairs.length === 0 || pairs.some((pair) => pair.length !== 2) || !(rounds > 0)) {
  console.error('usage: frame-times.mjs HYBRID.glb=LIGHTMAP.glb ... [--rounds 40] [--angle default] [--levels 0]')
  process.exit(1)
}

const { browser, files: served, open, close } = await startBrowser({
  root: fileURLToPath(new URL('../..', import.meta.url)), flags: [`--use-angle=${angle}`, '--ignore-gpu-blocklist'],
})
const session = await browser.newBrowserCDPSession()

function print(head, ...rows) {
  const rule = head.map((title) => (title === 'scene' ? '---' : '---:'))
  for (const row of [head, rule, ...rows]) console.log(`| ${row.join(' | ')} |`)
}

/** Seconds of all cores that drawing has taken: by Linux's scheduler to the nanosecond, else as the browser has them. */
async function processorTime() {
  const { processInfo } = await session.send('SystemInfo.getProcessInfo')
  const { id, cpuTime } = processInfo.find(({ type }) => type === 'GPU')
  const tasks = `/proc/${id}/task`
  if (!existsSync(tasks)) return cpuTime
  const taken = readdirSync(tasks).map((task) => Number(readFileSync(`${tasks}/${task}/schedstat`, 'utf8').split(' ')[0]))
  return taken.reduce((sum, ns) => sum + ns / 1e9, 0)
}

/** Milliseconds of each way and each ratio of a pair, a number per round. */
async function takeTimes(page, { names, renderer }) {
  const isSoftware = /swiftshader|llvmpipe|warp/i.test(renderer)
  const frames = async (name, repeats) => {
    const before = await processorTime()
    const passed = await page.evaluate(([name, repeats]) => globalThis.frames(name, repeats), [name, repeats])
    return (isSoftware ? 1000 * (await processorTime() - before) : passed) / repeats / VIEWS.length
  }
  // The first of each way compiles; then as often as it takes to be long for the clock.
  const [times, ratios, repeats] = [{}, {}, {}]
  for (const name of names) {
    await frames(name, 1)
    repeats[name] = Math.max(1, Math.ceil((isSoftware ? 200 : 20) / VIEWS.length / (await frames(name, 1))))
    times[name] = []
  }
  const pairs = PAIRS.filter((pair) => pair.every((name) => names.includes(name)))
  const alone = names.filter((name) => !pairs.flat().includes(name))
  for (let round = 0; round < rounds; round++) {
    for (const name of alone) times[name].push(await frames(name, repeats[name]))
    for (const [lightmap, hybrid] of pairs) {
      const taken = { [lightmap]: 0, [hybrid]: 0 }
      for (const name of [lightmap, hybrid, hybrid, lightmap]) taken[name] += (await frames(name, repeats[name])) / 2
      for (const name of [lightmap, hybrid]) times[name].push(taken[name])
      ratios[hybrid] ??= []
      ratios[hybrid].push(taken[hybrid] / taken[lightmap])
    }
  }
  return { times, ratios, about: `${renderer}, ${isSoftware ? 'processor time of drawing' : "time by the GPU's clock, or by that of the page"}` }
}

try {
  const [rows, fill] = [[], []]
  let about
  for (const [path, ofLightmap] of pairs) {
    const { triangles, ...meshes } = await readMeshes(...[path, ofLightmap].map((file) => new Uint8Array(readFileSync(file))))
    for (const [name, mesh] of Object.entries(meshes)) {
      for (const part of ['positions', 'attributes', 'indices']) served.set(`${name}.${part}`, Buffer.from(mesh[part].buffer))
      mesh.pages.forEach((page, i) => served.set(`${name}.page.${i}`, Buffer.from(page)))
    }
    const { page, complaints } = await open('/viewer/scenes/frame-times.html')
    const cameras = VIEWS.map((view) => clipFromWorld(cameraFor(triangles, view), 1920 / 1080))
    const sizes = Object.fromEntries(Object.entries(meshes).map(([name, { size, pages }]) => [name, [...size, pages.length]]))
    const prepared = await page.evaluate((job) => globalThis.prepare(job), { sizes, cameras, withFill: rows.length === 0, withLevels })
    const taken = await takeTimes(page, prepared)
    await page.close()
    if (complaints.length > 0) throw new Error(complaints.join('\n'))
    about = taken.about
    const ms = (name) => median(taken.times[name]).toFixed(1)
    const ratio = (hybrid) => {
      const [value, first, last] = [median(taken.ratios[hybrid]), ...medianInterval(taken.ratios[hybrid])].map((x) => x.toFixed(2))
      return `${value} (${first} to ${last})`
    }
    const pair = (lightmap, hybrid) => [ms(lightmap), ms(hybrid), ratio(hybrid)]
    rows.push([basename(path, '.glb').replace('.baked', ''), triangles.length, `${meshes.hybrid.vertices} / ${meshes.lightmap.vertices}`,
      `${(100 * prepared.textured).toFixed(0)} %`, ms('nothing'), ms('vertices'), ...pair('lightmap', 'hybrid'),
      ...(withLevels ? pair('lightmap, levels', 'hybrid, levels') : []), ...pair('material, lightmap', 'material, hybrid')])
    if (fill.length === 0) fill.push(ms('fill, nothing'), ...pair('fill, lightmap', 'fill, texels'), ...pair('fill, lightmap again', 'fill, colors'))
    console.error(rows.at(-1).join('  '))
  }
  console.log(`${about}; 1920 x 1080, no multisampling, ${VIEWS.length} views, ${rounds} rounds; medians in ms, and 95 % of where a ratio is\n`)
  const head = ['scene', 'triangles', 'vertices: hybrid / lightmap', 'pixels with texels', 'no light', 'vertices', 'lightmap', 'hybrid', 'ratio',
    ...(withLevels ? ['lightmap, mip levels', 'hybrid, mip levels', 'ratio'] : []), 'in a material: lightmap', 'hybrid', 'ratio']
  print(head, ...rows)
  console.log('\nA picture filled once:\n')
  print(['no light', 'lightmap', 'hybrid: texels', 'ratio', 'lightmap', 'hybrid: vertex values', 'ratio'], fill)
} finally {
  await close()
}
