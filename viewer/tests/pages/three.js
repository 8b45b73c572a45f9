// What the tests ask three.js to do: load a file, show it along an axis, hand over pixels.

import * as THREE from 'three'
import { DRACOLoader } from 'three/addons/loaders/DRACOLoader.js'
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js'
import { LightkilnPlugin } from 'three-lightkiln'
import { MeshoptDecoder } from 'meshoptimizer'

const SIZE = 256
// The page with WebGPURenderer names it in its import map.
const nodes = globalThis.withNodes ? (await import('three-lightkiln/webgpu')).lightkilnNodes : undefined
const renderer = nodes
  ? new THREE.WebGPURenderer({ forceWebGL: globalThis.withNodes === 'webgl' })
  : new THREE.WebGLRenderer({ preserveDrawingBuffer: true })
await renderer.init?.()
renderer.setSize(SIZE, SIZE)
renderer.setPixelRatio(1)
document.body.append(renderer.domElement)
const draco = new DRACOLoader().setDecoderPath('/node_modules/three/examples/jsm/libs/draco/')

let gltf = null
let scene = null

const base64 = (numbers) => {
  const bytes = new Uint8Array(numbers.buffer)
  let text = ''
  for (let i = 0; i < bytes.length; i += 32768) text += String.fromCharCode(...bytes.subarray(i, i + 32768))
  return btoa(text)
}

const materials = () => {
  const found = new Set()
  gltf.scene.traverse((object) => object.isMesh && [object.material].flat().forEach((material) => found.add(material)))
  return [...found]
}

globalThis.tests = {
  THREE,

  /** `roles`: signal to role; without it the plugin's own. `plugin: false` leaves it out. `before` is code for materials. */
  async load(url, { roles, plugin = true, ...options } = {}) {
    const loader = new GLTFLoader().setDRACOLoader(draco).setMeshoptDecoder(MeshoptDecoder)
    const role = roles && (({ signal }) => roles[signal] ?? 'none')
    if (plugin) loader.register((parser) => new LightkilnPlugin(parser, { ...options, role, nodes }))
    gltf = await loader.loadAsync(url)
    scene = new THREE.Scene()
    scene.add(gltf.scene)
    return { lit: gltf.userData.lightkiln !== undefined, materials: materials().map((m) => m.type) }
  },

  /** Runs code on the loaded file. */
  change(code) {
    return Function('gltf', 'scene', 'THREE', 'materials', 'renderer', code)(gltf, scene, THREE, materials(), renderer)
  },

  /** Stored values of a layer; only depth decides what is in front. */
  view(signal) {
    gltf.userData.lightkiln.view = signal
    for (const material of materials()) {
      Object.assign(material, { side: THREE.DoubleSide, transparent: false, alphaTest: 0, depthWrite: true, depthTest: true })
      Object.assign(material, { blending: THREE.NoBlending, transmission: 0, needsUpdate: true })
    }
  },

  /** Floats, RGBA, from the top; the camera looks along `-toward` at the box given. */
  pixels(camera) {
    const target = new THREE.WebGLRenderTarget(SIZE, SIZE, { type: THREE.FloatType, format: THREE.RGBAFormat, samples: 0 })
    renderer.setRenderTarget(target)
    renderer.setClearColor(0x000000, 0)
    renderer.clear()
    renderer.render(scene, tests.camera(camera))
    const numbers = new Float32Array(SIZE * SIZE * 4)
    renderer.readRenderTargetPixels(target, 0, 0, SIZE, SIZE, numbers)
    renderer.setRenderTarget(null)
    target.dispose()
    return base64(numbers)
  },

  backend: () => renderer.backend?.constructor.name,

  /** As `pixels`, of WebGPURenderer. */
  async pixelsOfNodes(camera) {
    const target = new THREE.RenderTarget(SIZE, SIZE, { type: THREE.FloatType, format: THREE.RGBAFormat, samples: 0 })
    renderer.setRenderTarget(target)
    renderer.setClearColor(0x000000, 0)
    renderer.render(scene, tests.camera(camera))
    const numbers = await renderer.readRenderTargetPixelsAsync(target, 0, 0, SIZE, SIZE)
    renderer.setRenderTarget(null)
    target.dispose()
    // WebGPU's first row is the topmost.
    const rows = Array.from({ length: SIZE }, (_, y) => numbers.subarray(y * SIZE * 4, (y + 1) * SIZE * 4))
    if (tests.backend() === 'WebGPUBackend') rows.reverse()
    return base64(Float32Array.from(rows.flatMap((row) => [...row])))
  },

  /** As `pixels`, through the canvas: 8 bits. */
  canvas(camera) {
    renderer.setClearColor(0x000000, 1)
    renderer.render(scene, tests.camera(camera))
    const gl = renderer.getContext()
    const bytes = new Uint8Array(SIZE * SIZE * 4)
    gl.readPixels(0, 0, SIZE, SIZE, gl.RGBA, gl.UNSIGNED_BYTE, bytes)
    return base64(Float32Array.from(bytes))
  },

  camera({ right, up, toward, center, half, depth }) {
    const camera = new THREE.OrthographicCamera(-half, half, half, -half, 0, 2 * depth)
    const basis = new THREE.Matrix4().makeBasis(...[right, up, toward].map((v) => new THREE.Vector3(...v)))
    const eye = new THREE.Vector3(...center).addScaledVector(new THREE.Vector3(...toward), depth)
    camera.matrixAutoUpdate = false
    camera.matrix.copy(basis.setPosition(eye))
    camera.matrixWorldNeedsUpdate = true
    return camera
  },

  programs: () => renderer.info.programs.length,
}
globalThis.ready = true
