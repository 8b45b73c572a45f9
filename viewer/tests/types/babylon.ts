// What READMEs show of babylon-lightkiln, with types.

import { AppendSceneAsync } from '@babylonjs/core/Loading/sceneLoader.js'
import { PBRMaterial } from '@babylonjs/core/Materials/PBR/pbrMaterial.js'
import type { Scene } from '@babylonjs/core/scene.js'
import '@babylonjs/loaders/glTF/2.0/index.js'
import { LightkilnMaterialPlugin, registerLightkiln, type Light } from 'babylon-lightkiln'

export async function show(scene: Scene): Promise<Light[]> {
  const lights: Light[] = []
  registerLightkiln()
  registerLightkiln({ irradianceIntensity: 0.001, role: ({ signal }) => (signal === 'shadow' ? 'shadow' : 'none'), onLight: (light) => lights.push(light) })
  await AppendSceneAsync('chair.baked.glb', scene)
  const [light] = lights
  if (light?.isReady === true) {
    light.view = light.layers[0]?.signal ?? null
    const material = new PBRMaterial('own', scene)
    light.apply(material)
    const plugin = material.pluginManager?.getPlugin(LightkilnMaterialPlugin.NAME)
    console.log(plugin instanceof LightkilnMaterialPlugin && plugin.light.shadowIntensity)
    light.dispose()
  }
  return lights
}
// @ts-expect-error intensities are numbers
registerLightkiln({ occlusionIntensity: 'much' })
