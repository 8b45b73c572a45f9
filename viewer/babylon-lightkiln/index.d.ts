import type { Layer, Role } from 'lightkiln-format'
import type { Material } from '@babylonjs/core/Materials/material.js'
import { MaterialPluginBase } from '@babylonjs/core/Materials/materialPluginBase.js'
import type { BaseTexture } from '@babylonjs/core/Materials/Textures/baseTexture.js'

export type { Layer, Role }

export interface LightkilnOptions {
  /**
   * What each layer does. By default `ambientOcclusion` is `'occlusion'`; `irradiance`, or else `direct` and `indirect`,
   * are `'irradiance'`, as are harmonics in their place (`'harmonics'`); all others are `'none'` and not loaded.
   */
  role?: (layer: Layer, layers: Layer[]) => Role | undefined
  /** 0: none, 1: as baked. */
  occlusionIntensity?: number
  /** Irradiance is in lux; this factor brings it to the units of your other lights. 1 by default. */
  irradianceIntensity?: number
  /** 0: none, 1: as baked. */
  shadowIntensity?: number
  /** Called with the light of each file that has one. */
  onLight?: (light: Light) => void
}

/** From now on, Babylon's glTF loader shows baked light. Calling it again replaces the options. */
export function registerLightkiln(options?: LightkilnOptions): void

/** The light of a file. */
export class Light {
  readonly layers: (Layer & { role: Role; atlas: BaseTexture | null | undefined; palette: BaseTexture | null | undefined })[]
  /** `null` while textures are loading, `false` when they could not be loaded. */
  readonly isReady: boolean | null
  occlusionIntensity: number
  irradianceIntensity: number
  shadowIntensity: number
  /** Shows the stored values of a layer, by its signal, in place of all materials; `null` ends that. */
  view: string | null
  /** Lets a material of your own show the light. It must be a PBRMaterial that was not yet rendered. */
  apply(material: Material): void
  /** Frees the textures. */
  dispose(): void
}

export class LightkilnMaterialPlugin extends MaterialPluginBase {
  constructor(material: Material, light: Light)
  static readonly NAME: 'Lightkiln'
  readonly light: Light
}
