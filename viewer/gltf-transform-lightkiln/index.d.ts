import { Extension, ExtensionProperty, type IProperty } from '@gltf-transform/core'

export interface LightmapImage {
  bytes: Uint8Array
  mimeType: string
  uri: string
}

interface ILightmap extends IProperty {
  def: Record<string, unknown>
  images: LightmapImage[]
  fallback: string
  color0: string
  triangles: number
}

/** The light of a file: `document.getRoot().getExtension('LIGHTKILN_lightmap')`. */
export class Lightmap extends ExtensionProperty<ILightmap> {
  readonly extensionName: 'LIGHTKILN_lightmap'
  readonly propertyType: 'Lightmap'
  readonly parentTypes: ['Root']
  protected init(): void
  /** The root object of the file, where `pages` and `table` are numbers of {@link getImages}. */
  getDef(): Record<string, unknown>
  setDef(def: Record<string, unknown>): this
  getImages(): LightmapImage[]
  setImages(images: LightmapImage[]): this
  getFallback(): string
  setFallback(semantic: string): this
  getColor0(): string
  setColor0(semantic: string): this
  /** Triangles that the light was baked for; writing warns when some of them are gone. */
  getTriangles(): number
  setTriangles(count: number): this
}

/** `new NodeIO().registerExtensions([...ALL_EXTENSIONS, LightkilnLightmap])`. */
export class LightkilnLightmap extends Extension {
  static readonly EXTENSION_NAME: 'LIGHTKILN_lightmap'
  readonly extensionName: 'LIGHTKILN_lightmap'
  createLightmap(): Lightmap
  read(context: unknown): this
  write(context: unknown): this
}
