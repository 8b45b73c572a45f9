// What READMEs show of three-lightkiln, with types.

import * as THREE from 'three'
import { GLTFLoader } from 'three/addons/loaders/GLTFLoader.js'
import { LightkilnPlugin, type Light, type LightkilnOptions, type Role } from 'three-lightkiln'
import { light as lightNode, lightkilnNodes, storedLight } from 'three-lightkiln/webgpu'

const options: LightkilnOptions = {
  role: ({ signal }) => (signal === 'shadow' ? 'shadow' : undefined),
  occlusionIntensity: 0.5,
  irradianceIntensity: 0.001,
  nodes: lightkilnNodes,
}
const loader = new GLTFLoader()
loader.register((parser) => new LightkilnPlugin(parser))
loader.register((parser) => new LightkilnPlugin(parser, options))
const gltf = await loader.loadAsync('chair.baked.glb')
const light: Light | undefined = gltf.userData.lightkiln
if (light !== undefined) {
  light.view = 'ambientOcclusion'
  light.view = null
  light.occlusionIntensity = 0.8
  light.apply(new THREE.Mesh())
  light.applyTo([gltf.scene])
  const roles: Role[] = light.layers.map(({ role }) => role)
  const nodes = light.layers.map((layer) => [storedLight(layer), lightNode(layer)])
  console.log(roles, nodes, light.uniforms.lightkilnOcclusionIntensity?.value)
  light.dispose()
}
// @ts-expect-error there is no such role
export const wrong: LightkilnOptions = { role: () => 'glow' }
