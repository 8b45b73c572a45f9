// Light alone in three.js or Babylon.js, as `?engine=` says. `globalThis.show(url, camera, background, irradianceIntensity)` is
// called by side-by-side.mjs; all materials of the file are white. Files with the extension are shown with the plugin, and their
// materials are unlit, so that occlusion is a factor of 1 and irradiance of 1 / pi; without it, an ambient light of 1 shows what
// the core occlusionTexture dims.

const canvas = document.querySelector('canvas')
const engines = { three, babylon }
globalThis.show = await engines[new URLSearchParams(location.search).get('engine')]()
globalThis.ready = true

async function three() {
  const THREE = await import('three')
  const { GLTFLoader } = await import('three/addons/loaders/GLTFLoader.js')
  const { LightkilnPlugin } = await import('three-lightkiln')
  const renderer = new THREE.WebGLRenderer({ canvas, antialias: false, preserveDrawingBuffer: true })
  renderer.setSize(canvas.width, canvas.height, false)
  return async (url, { eye, right, up, forward, tangent, near, far }, background, irradianceIntensity) => {
    const loader = new GLTFLoader()
    loader.register((parser) => new LightkilnPlugin(parser, { irradianceIntensity }))
    const gltf = await loader.loadAsync(url)
    const scene = new THREE.Scene()
    scene.background = new THREE.Color().setRGB(...background, THREE.LinearSRGBColorSpace)
    scene.add(gltf.scene, new THREE.AmbientLight(0xffffff, Math.PI))
    const camera = new THREE.Camera()
    const end = tangent * near
    camera.projectionMatrix.makePerspective(-end, end, end, -end, near, far)
    camera.projectionMatrixInverse.copy(camera.projectionMatrix).invert()
    camera.matrixAutoUpdate = false
    const axes = [right, up, forward.map((x) => -x)].map((axis) => new THREE.Vector3(...axis))
    camera.matrix.makeBasis(...axes).setPosition(...eye)
    camera.matrixWorldNeedsUpdate = true
    renderer.render(scene, camera)
    return gltf.userData.lightkiln !== undefined
  }
}

async function babylon() {
  const { Color3, Color4 } = await import('@babylonjs/core/Maths/math.color.js')
  const { Vector3 } = await import('@babylonjs/core/Maths/math.vector.js')
  const { FreeCamera } = await import('@babylonjs/core/Cameras/freeCamera.js')
  const { Engine } = await import('@babylonjs/core/Engines/engine.js')
  const { Scene } = await import('@babylonjs/core/scene.js')
  const { LoadAssetContainerAsync } = await import('@babylonjs/core/Loading/sceneLoader.js')
  await import('@babylonjs/loaders/glTF/2.0/index.js')
  const { registerLightkiln } = await import('babylon-lightkiln')
  const engine = new Engine(canvas, false, { preserveDrawingBuffer: true, premultipliedAlpha: false })
  return async (url, { eye, forward, up, tangent, near, far }, background, irradianceIntensity) => {
    let light
    registerLightkiln({ irradianceIntensity, onLight: (found) => { light = found } })
    const scene = new Scene(engine)
    scene.useRightHandedSystem = true
    // Babylon's own way from light to the screen.
    scene.clearColor = new Color4(...background.map((x) => x ** (1 / 2.2)), 1)
    const container = await LoadAssetContainerAsync(url, scene)
    container.addAllToScene()
    if (light === undefined) {
      scene.ambientColor = new Color3(1, 1, 1)
      for (const material of scene.materials) material.ambientColor = new Color3(1, 1, 1)
    }
    const camera = new FreeCamera('camera', new Vector3(...eye), scene)
    camera.upVector = new Vector3(...up)
    camera.setTarget(camera.position.add(new Vector3(...forward)))
    Object.assign(camera, { fov: 2 * Math.atan(tangent), minZ: near, maxZ: far })
    await scene.whenReadyAsync()
    scene.render()
    // Babylon keeps textures by the address of their file, as long as a scene has them.
    scene.dispose()
    return light?.isReady === true
  }
}
