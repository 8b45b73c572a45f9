// What the tests ask Babylon.js to do: load a file, show it along an axis, hand over pixels.

import { FreeCamera } from '@babylonjs/core/Cameras/freeCamera.js'
import { Camera } from '@babylonjs/core/Cameras/camera.js'
import { Engine } from '@babylonjs/core/Engines/engine.js'
import { DirectionalLight } from '@babylonjs/core/Lights/directionalLight.js'
import { LoadAssetContainerAsync } from '@babylonjs/core/Loading/sceneLoader.js'
import { Color3, Color4 } from '@babylonjs/core/Maths/math.color.js'
import { Vector3 } from '@babylonjs/core/Maths/math.vector.js'
import { Material } from '@babylonjs/core/Materials/material.js'
import { RawTexture } from '@babylonjs/core/Materials/Textures/rawTexture.js'
import { RawCubeTexture } from '@babylonjs/core/Materials/Textures/rawCubeTexture.js'
import { DracoDecoder } from '@babylonjs/core/Meshes/Compression/dracoDecoder.js'
import { MeshoptCompression } from '@babylonjs/core/Meshes/Compression/meshoptCompression.js'
import { Scene } from '@babylonjs/core/scene.js'
import '@babylonjs/core/Helpers/sceneHelpers.js'
import '@babylonjs/loaders/glTF/2.0/index.js'
import { unregisterGLTFExtension } from '@babylonjs/loaders/glTF/2.0/glTFLoaderExtensionRegistry.js'
import { registerLightkiln } from 'babylon-lightkiln'

const SIZE = 256
const canvas = document.querySelector('canvas')
const engine = new Engine(canvas, false, { preserveDrawingBuffer: true, premultipliedAlpha: false })
DracoDecoder.DefaultConfiguration = {
  wasmUrl: '/node_modules/three/examples/jsm/libs/draco/gltf/draco_wasm_wrapper.js',
  wasmBinaryUrl: '/node_modules/three/examples/jsm/libs/draco/gltf/draco_decoder.wasm',
  fallbackUrl: '/node_modules/three/examples/jsm/libs/draco/gltf/draco_decoder.js',
}
MeshoptCompression.Configuration = { decoder: { url: '/node_modules/meshoptimizer/meshopt_decoder.cjs' } }

let scene = null
let light = null

const base64 = (numbers) => {
  const bytes = new Uint8Array(numbers.buffer)
  let text = ''
  for (let i = 0; i < bytes.length; i += 32768) text += String.fromCharCode(...bytes.subarray(i, i + 32768))
  return btoa(text)
}

globalThis.tests = {
  async load(url, { roles, plugin = true, ...options } = {}) {
    scene?.dispose()
    light = null
    scene = new Scene(engine)
    scene.useRightHandedSystem = true
    scene.clearColor = new Color4(0, 0, 0, 1)
    const role = roles && (({ signal }) => roles[signal] ?? 'none')
    registerLightkiln({ ...options, role, onLight: (found) => { light = found } })
    if (!plugin) unregisterGLTFExtension('LIGHTKILN_lightmap')
    const container = await LoadAssetContainerAsync(url, scene)
    container.addAllToScene()
    return { lit: light !== null && light.isReady === true, materials: scene.materials.map((m) => m.getClassName()) }
  },

  change(code) {
    const names = { scene, light, Color3, Vector3, DirectionalLight, RawTexture, RawCubeTexture, Material }
    return Function(...Object.keys(names), code)(...Object.values(names))
  },

  view(signal) {
    light.view = signal
    for (const material of scene.materials) {
      Object.assign(material, { backFaceCulling: false, transparencyMode: Material.MATERIAL_OPAQUE, disableDepthWrite: false })
    }
  },

  /** Floats 0..1 from 8 bits, RGBA, from the bottom. */
  async pixels({ right, up, toward, center, half, depth }) {
    scene.activeCamera?.dispose()
    const [front, middle] = [new Vector3(...toward), new Vector3(...center)]
    const camera = new FreeCamera('camera', middle.add(front.scale(depth)), scene)
    camera.upVector = new Vector3(...up)
    camera.setTarget(middle)
    camera.mode = Camera.ORTHOGRAPHIC_CAMERA
    Object.assign(camera, { orthoLeft: -half, orthoRight: half, orthoBottom: -half, orthoTop: half, minZ: 0, maxZ: 2 * depth })
    scene.activeCamera = camera
    await scene.whenReadyAsync()
    scene.render()
    const bytes = await engine.readPixels(0, 0, SIZE, SIZE)
    return base64(Float32Array.from(bytes, (x) => x / 255))
  },
}
globalThis.ready = true
