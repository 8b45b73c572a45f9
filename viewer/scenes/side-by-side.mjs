// The light of baked files side by side: `lightkiln render` on the CPU, three.js and Babylon.js, from one camera, compared.
//
//   node side-by-side.mjs OUT_DIR NAME=FILE.glb[,OTHER.glb] ...
//
// OTHER.glb is the same scene in a form that needs no plugin, such as the profile `stock`; it gets columns of its own, and its
// pictures are compared with that of the CPU of the same file. Prints a table in Markdown and writes OUT_DIR/NAME.WAY.png and
// OUT_DIR/contact.png. FLIP (Andersson et al. 2020) is measured when FLIP_PYTHON names a Python with the packages flip-evaluator
// and numpy. Ends with 1 when a picture is beyond its bound.
//
// GLOSS=1 leaves the white materials of OTHER.glb their gloss, which takes light from what is diffuse: see docs/VIEWERS.md.

import { execFileSync } from 'node:child_process'
import { mkdirSync, readFileSync, rmSync, writeFileSync } from 'node:fs'
import { join } from 'node:path'
import { fileURLToPath } from 'node:url'
import { EXTENSION, readExtension, readPng } from 'lightkiln-format'
import { startBrowser } from '../tests/browser.mjs'
import { readGlb, writeGlb, writePng } from '../tests/glb.mjs'
import { readScene } from '../tests/scene.mjs'

const PROGRAM = process.env.LIGHTKILN ?? fileURLToPath(new URL('../../target/release/lightkiln', import.meta.url))
const SIZE = 512
/** Pictures are taken larger, and averaged in linear light, so that edges are smoothed alike everywhere. */
const [CPU_SIZE, GPU_SIZE] = [2 * SIZE, 4 * SIZE]
/**
 * Largest root mean square difference of a picture, of numbers as displayed, 1 being white; and largest mean FLIP. A file in
 * another form is a bake of its own: both are within the bound of their light, 3 %, and not within that of one picture.
 */
const BOUNDS = { engines: { rmse: 0.005, flip: 0.015 }, bakes: { rmse: 0.015, flip: 0.015 } }
/** As crates/render has them: linear color behind things, half the opening, and the margin around things. */
const [BACKGROUND, TANGENT, MARGIN] = [[0.28, 0.32, 0.38], 0.25, 1.06]
const VIEW = [35, 20]
/** Without it a white material is a dielectric, and engines take from diffuse light what its gloss would reflect. */
const MATTE = { KHR_materials_specular: { specularFactor: 0 } }

/** The camera of `lightkiln render --view AZIMUTH,ELEVATION`: crates/render/src/camera.rs, `Camera::framing`. */
function framing(triangles, [azimuth, elevation]) {
  const [sin, cos] = [Math.sin, Math.cos].map((of) => (degrees) => of((degrees * Math.PI) / 180))
  const forward = [sin(azimuth) * cos(elevation), sin(elevation), cos(azimuth) * cos(elevation)].map((x) => -x)
  const right = [cos(azimuth), 0, -sin(azimuth)]
  const up = [right[1] * forward[2] - right[2] * forward[1], right[2] * forward[0] - right[0] * forward[2], right[0] * forward[1] - right[1] * forward[0]]
  const frame = [right, up, forward]
  const axes = (p) => frame.map((axis) => axis.reduce((sum, x, k) => sum + x * p[k], 0))
  const points = triangles.flatMap(({ corners }) => corners.map(axes))
  const [low, high] = [Math.min, Math.max].map((of) => [0, 1, 2].map((k) => points.reduce((end, p) => of(end, p[k]), points[0][k])))
  const middle = low.map((x, k) => (x + high[k]) / 2)
  const distance = points.reduce((most, p) => {
    const across = Math.max(Math.abs(p[0] - middle[0]), Math.abs(p[1] - middle[1]))
    return Math.max(most, (across * MARGIN) / TANGENT - (p[2] - middle[2]))
  }, 1e-6)
  const eye = [0, 1, 2].map((k) => frame.reduce((sum, axis, i) => sum + axis[k] * (middle[i] - (i === 2 ? distance : 0)), 0))
  const depth = high[2] - low[2]
  return { eye, right, up, forward, tangent: TANGENT, near: Math.max(distance - depth, distance / 1000), far: distance + depth }
}

/** The file with white materials; what is mostly transparent is left out, as `render` looks through it. */
function whitened(bytes, isUnlit) {
  const file = readGlb(bytes)
  const { json } = file
  const isThin = ({ alphaMode, pbrMetallicRoughness: { baseColorFactor = [1, 1, 1, 1] } = {}, extensions = {} } = {}) =>
    (alphaMode === 'BLEND' ? baseColorFactor[3] : 1) * (1 - (extensions.KHR_materials_transmission?.transmissionFactor ?? 0)) < 0.5
  json.materials ??= []
  for (const mesh of json.meshes) {
    mesh.primitives = mesh.primitives.filter(({ material, mode = 4 }) => mode >= 4 && !isThin(json.materials[material]))
    for (const { attributes, extensions } of mesh.primitives) {
      const light = extensions?.[EXTENSION]
      delete light?.color0
      if (light === undefined) delete attributes.COLOR_0
    }
  }
  json.nodes.forEach((node) => { if (json.meshes[node.mesh]?.primitives.length === 0) delete node.mesh })
  json.materials = json.materials.map(({ doubleSided, occlusionTexture }) => ({
    ...(doubleSided && { doubleSided }), ...(!isUnlit && occlusionTexture && { occlusionTexture }),
    pbrMetallicRoughness: { baseColorFactor: [1, 1, 1, 1], metallicFactor: 0, roughnessFactor: 1 },
    ...(isUnlit ? { extensions: { KHR_materials_unlit: {} } } : !process.env.GLOSS && { extensions: MATTE }),
  }))
  json.extensionsUsed = [...new Set([...json.extensionsUsed ?? [], 'KHR_materials_unlit', ...Object.keys(MATTE)])]
  return writeGlb(file)
}

const toLinear = { srgb: (x) => (x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4), 'gamma 2.2': (x) => x ** 2.2 }
const toSrgb = (x) => (x <= 0.0031308 ? 12.92 * x : 1.055 * x ** (1 / 2.4) - 0.055)

/**
 * SIZE x SIZE pixels of RGB as displayed, from a larger picture in 8 bits.
 *
 * What has the color of the first pixel is background, and is the same in all pictures: 8 bits of different curves round it
 * to different hues.
 */
function smaller({ width, channels, data }, curve) {
  const table = Float64Array.from({ length: 256 }, (_, i) => toLinear[curve](i / 255))
  const factor = width / SIZE
  const sums = new Float64Array(SIZE * SIZE * 3)
  for (let y = 0; y < width; y++) {
    for (let x = 0; x < width; x++) {
      const [from, to] = [(y * width + x) * channels, (Math.floor(y / factor) * SIZE + Math.floor(x / factor)) * 3]
      const isGround = [0, 1, 2].every((c) => data[from + c] === data[c])
      for (let c = 0; c < 3; c++) sums[to + c] += isGround ? BACKGROUND[c] : table[data[from + c]]
    }
  }
  return sums.map((sum) => toSrgb(sum / factor ** 2))
}

function difference(a, b) {
  let [square, largest, off] = [0, 0, 0]
  for (let i = 0; i < a.length; i += 3) {
    const errors = [0, 1, 2].map((c) => Math.abs(a[i + c] - b[i + c]))
    square += errors.reduce((sum, error) => sum + error ** 2, 0)
    largest = Math.max(largest, ...errors)
    if (Math.max(...errors) > 8 / 255) off++
  }
  return { rmse: Math.sqrt(square / a.length), largest, off: (3 * off) / a.length }
}

/** Mean FLIP of two files of pictures. */
function flip(reference, test) {
  const code = 'import sys, flip_evaluator as f; print(f.evaluate(sys.argv[1], sys.argv[2], "LDR")[1])'
  return Number(execFileSync(process.env.FLIP_PYTHON, ['-c', code, reference, test], { encoding: 'utf8' }))
}

const [folder, ...scenes] = process.argv.slice(2)
if (scenes.length === 0) {
  console.error('usage: side-by-side.mjs OUT_DIR NAME=FILE.glb[,OTHER.glb] ...')
  process.exit(1)
}
mkdirSync(folder, { recursive: true })
const browser = await startBrowser()
const pages = {}
for (const engine of ['three', 'babylon']) {
  pages[engine] = await browser.open(`/scenes/side-by-side.html?engine=${engine}`, { width: GPU_SIZE, height: GPU_SIZE })
}

async function inEngine(engine, bytes, camera, isLit, irradianceIntensity) {
  const { page, complaints } = pages[engine]
  browser.files.set('file.glb', whitened(bytes, isLit))
  const shown = await page.evaluate((job) => globalThis.show('/files/file.glb', ...job), [camera, BACKGROUND, irradianceIntensity])
  if (shown !== isLit || complaints.length > 0) throw new Error(`${engine}: ${complaints.join('; ') || 'no light'}`)
  const png = await page.locator('canvas').screenshot({ type: 'png' })
  return smaller(await readPng(new Uint8Array(png)), engine === 'babylon' ? 'gamma 2.2' : 'srgb')
}

async function onCpu(path) {
  const large = join(folder, 'cpu.png')
  execFileSync(PROGRAM, ['render', path, '-o', large, '--mode', 'light', '--view', VIEW.join(), '--size', String(CPU_SIZE), '--quiet'])
  const picture = smaller(await readPng(new Uint8Array(readFileSync(large))), 'srgb')
  rmSync(large)
  return picture
}

const rows = []
let beyond = false
for (const scene of scenes) {
  const [name, paths] = scene.split('=')
  const [path, other] = paths.split(',')
  const bytes = new Uint8Array(readFileSync(path))
  const [layer] = readExtension(readGlb(bytes).json).layers
  const camera = framing((await readScene(bytes)).triangles, VIEW)
  const pictures = { CPU: await onCpu(path) }
  // The CPU shows irradiance as a share of white.
  const intensity = layer.scale.white > 0 ? Math.PI / layer.scale.white : 1
  for (const engine of ['three', 'babylon']) pictures[engine] = await inEngine(engine, bytes, camera, true, intensity)
  if (other !== undefined) {
    pictures['CPU, core'] = await onCpu(other)
    for (const engine of ['three', 'babylon']) pictures[`${engine}, core`] = await inEngine(engine, new Uint8Array(readFileSync(other)), camera, false, 1)
  }
  const file = (way) => join(folder, `${name}.${way.replace(', ', '-')}.png`)
  for (const [way, pixels] of Object.entries(pictures)) {
    writeFileSync(file(way), writePng({ width: SIZE, height: SIZE, channels: 3, bits: 8, data: Uint8Array.from(pixels, (x) => Math.round(255 * x)) }))
    if (way === 'CPU') continue
    const isBake = way === 'CPU, core'
    const against = way.endsWith(', core') && !isBake ? 'CPU, core' : 'CPU'
    const { rmse, largest, off } = difference(pixels, pictures[against])
    const mean = process.env.FLIP_PYTHON ? flip(file(against), file(way)) : undefined
    const bound = BOUNDS[isBake ? 'bakes' : 'engines']
    const isOver = rmse > bound.rmse || mean > bound.flip
    beyond ||= isOver
    rows.push([name, layer.signal, way, against, rmse.toFixed(4), `${(100 * off).toFixed(2)} %`, largest.toFixed(2), mean?.toFixed(4) ?? '', isOver ? 'BEYOND' : 'yes'])
    console.error(rows.at(-1).join('  '))
  }
  rows.at(-1).pictures = Object.keys(pictures).map((way) => [way, file(way)])
}

const sheets = rows.filter(({ pictures }) => pictures !== undefined)
const image = (path) => `<img width=230 height=230 src="data:image/png;base64,${readFileSync(path).toString('base64')}">`
const line = ({ pictures, 0: name }) => `<tr><th>${name.replaceAll('_', ' ')}</th>${pictures.map(([, path]) => `<td>${image(path)}</td>`).join('')}</tr>`
const most = sheets.reduce((best, { pictures }) => (pictures.length > best.length ? pictures : best), [])
browser.files.set('contact.html', Buffer.from(`<!doctype html><meta charset="utf-8"><link rel="icon" href="data:,">
  <style> body { margin: 0 } table { font: 14px sans-serif; border-spacing: 4px } th { font-weight: normal } tr > th:first-child { writing-mode: sideways-lr } img { display: block } </style>
  <table><tr><th></th>${most.map(([way]) => `<th>${way}</th>`).join('')}</tr>${sheets.map(line).join('')}</table>`))
const { page } = await browser.open('/files/contact.html', { width: 1200, height: 800 }, () => [...document.images].every((image) => image.complete))
await page.locator('table').screenshot({ path: join(folder, 'contact.png') })
await browser.close()

const said = ({ rmse, flip }) => `RMSE ${rmse}, mean FLIP ${flip}`
console.log(`${SIZE} x ${SIZE} pixels; bounds: ${said(BOUNDS.engines)}; of two bakes: ${said(BOUNDS.bakes)}\n`)
const head = ['scene', 'layer', 'picture', 'against', 'RMSE', 'off by more than 8 of 255', 'largest', 'mean FLIP', 'within the bounds']
for (const row of [head, head.map((_, i) => (i < 4 || i === 8 ? '---' : '---:')), ...rows]) console.log(`| ${row.join(' | ')} |`)
process.exit(beyond ? 1 : 0)
