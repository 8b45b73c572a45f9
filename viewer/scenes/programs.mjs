// The programs that three.js makes of a lit material: with no baked light, with a lightmap, and with ours.
//
//   node programs.mjs OUT_DIR
//
// Writes OUT_DIR/NAME.vert.glsl and NAME.frag.glsl as the browser is given them. tests/gpu/instructions.py counts their instructions.

import { mkdirSync, writeFileSync } from 'node:fs'
import { join } from 'node:path'
import { fileURLToPath } from 'node:url'
import { startBrowser } from '../tests/browser.mjs'

const folder = process.argv[2]
if (folder === undefined) {
  console.error('usage: programs.mjs OUT_DIR')
  process.exit(1)
}

/** In the page: sources of both stages by name. */
async function sources() {
  const THREE = await import('three')
  const { RoomEnvironment } = await import('three/addons/environments/RoomEnvironment.js')
  const { Light } = await import('three-lightkiln')
  const renderer = new THREE.WebGLRenderer()
  const environment = new THREE.PMREMGenerator(renderer).fromScene(new RoomEnvironment()).texture
  const gl = renderer.getContext()
  const texel = (format, channel) => Object.assign(new THREE.DataTexture(new Uint8Array(4), 1, 1, format), { channel, needsUpdate: true })
  const geometry = new THREE.BufferGeometry()
  for (const [name, size] of [['position', 3], ['normal', 3], ['uv1', 2]]) geometry.setAttribute(name, new THREE.BufferAttribute(new Float32Array(3 * size), size))
  geometry.setAttribute('_lightuv', new THREE.BufferAttribute(new Uint16Array(6), 2))

  const layer = { index: 0, attribute: '_LIGHTUV', clamp: null, pages: [0], palette: null }
  const occlusion = { ...layer, signal: 'ambientOcclusion', channels: 1, form: 'scalar', role: 'occlusion', scale: { low: 0, extent: 1, white: 0 } }
  const irradiance = { ...layer, signal: 'irradiance', channels: 3, form: 'rgb', role: 'irradiance', scale: { low: 0, extent: 1, white: 1 } }
  const lights = (of, format) => new Light([{ ...of, atlas: texel(format, 0) }], [1, 1])
  const ways = {
    nothing: [{}],
    'occlusion lightmap': [{ aoMap: texel(THREE.RedFormat, 1) }],
    'occlusion hybrid': [{}, lights(occlusion, THREE.RedFormat)],
    'irradiance lightmap': [{ lightMap: texel(THREE.RGBAFormat, 1) }],
    'irradiance hybrid': [{}, lights(irradiance, THREE.RGBAFormat)],
  }
  const found = {}
  for (const [name, [maps, light]] of Object.entries(ways)) {
    const material = new THREE.MeshStandardMaterial({ roughness: 0.6, ...maps })
    const mesh = new THREE.Mesh(geometry, material)
    mesh.frustumCulled = false
    const scene = new THREE.Scene()
    scene.environment = environment
    scene.add(mesh, new THREE.DirectionalLight(0xffffff, 1))
    light?.apply(mesh)
    renderer.render(scene, new THREE.PerspectiveCamera())
    const { vertexShader, fragmentShader } = renderer.properties.get(material).currentProgram
    found[name] = [vertexShader, fragmentShader].map((shader) => gl.getShaderSource(shader))
  }
  return found
}

const { open, close } = await startBrowser({ root: fileURLToPath(new URL('../..', import.meta.url)) })
try {
  const { page, complaints } = await open('/viewer/scenes/frame-times.html')
  const found = await page.evaluate(sources)
  if (complaints.length > 0) throw new Error(complaints.join('\n'))
  mkdirSync(folder, { recursive: true })
  for (const [name, stages] of Object.entries(found)) {
    stages.forEach((source, k) => writeFileSync(join(folder, `${name}.${['vert', 'frag'][k]}.glsl`), source))
  }
} finally {
  await close()
}
