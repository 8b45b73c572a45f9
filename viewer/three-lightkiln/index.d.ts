import type { Layer, Role } from 'lightkiln-format'
import type { DataArrayTexture, DataTexture, IUniform, Material, Mesh, Object3D } from 'three'
import type { GLTF, GLTFLoaderPlugin, GLTFParser } from 'three/addons/loaders/GLTFLoader.js'

export type { Layer, Role }

export interface LightkilnOptions {
  /**
   * What each layer does. By default `ambientOcclusion` is `'occlusion'`; `irradiance`, or else `direct` and `indirect`,
   * are `'irradiance'`; all others are `'none'` and not loaded.
   */
  role?: (layer: Layer, layers: Layer[]) => Role | undefined
  /** 0: none, 1: as baked. */
  occlusionIntensity?: number
  /** Irradiance is in lux; this factor brings it to the units of your other lights. 1 by default. */
  irradianceIntensity?: number
  /** 0: none, 1: as baked. */
  shadowIntensity?: number
  /** With WebGPURenderer: `lightkilnNodes` of `three-lightkiln/webgpu`. */
  nodes?: NodeSupport
}

/** Makes node materials with light; opaque. */
export interface NodeSupport {
  material(material: Material, owner: Light, layers: Light['layers'], view: Light['layers'][number] | null): Material
}

/** The light of a file: `gltf.userData.lightkiln`, undefined for files without. */
export class Light {
  /** All layers of the file; those whose role is `'none'` have no textures. */
  readonly layers: (Layer & { role: Role; atlas: DataTexture | DataArrayTexture | null; palette: DataTexture | null })[]
  /** What materials with light share. Shaders of your own may use them. */
  readonly uniforms: Record<string, IUniform>
  occlusionIntensity: number
  irradianceIntensity: number
  shadowIntensity: number
  /** Shows the stored values of a layer, by its signal, in place of all materials; `null` ends that. */
  view: string | null
  /** Lets the material of a mesh show its light; needed again after you gave the mesh another material. */
  apply(mesh: Mesh): void
  /** {@link apply} to all meshes below; materials that meshes without light share are copied. */
  applyTo(roots: Object3D[]): void
  /** Frees the textures. */
  dispose(): void
}

/** `loader.register((parser) => new LightkilnPlugin(parser))` */
export class LightkilnPlugin implements GLTFLoaderPlugin {
  constructor(parser: GLTFParser, options?: LightkilnOptions)
  readonly name: 'LIGHTKILN_lightmap'
  beforeRoot(): Promise<void>
  afterRoot(gltf: GLTF): Promise<void>
}
