export const EXTENSION: 'LIGHTKILN_lightmap'
export const VERSION: 2
export const COLOR_FLAG: number
export const COLOR_STEPS: number
export const RGB_STEPS: [number, number, number]
export const RGB_SHIFTS: [number, number, number]
export const LOW_BITS: number
export const TABLE_WIDTH: number
export const SUBTEXELS: number
export const ETA_EPSILON: number
export const INTEROP_COLOR: number
export const CURVE_KNEE: number
export const CURVE_BASE: number
export const SH_CONSTANT: number
export const SH_LINEAR: number
export const SH_PRODUCT: number
export const SH_AXIS: number
export const SH_DIFFERENCE: number

/** How the color of a color-vertex is stored. */
export type Form = 'scalar' | 'rgb' | 'table'
/**
 * What a layer does in a picture: dims indirect light, adds indirect light (by itself, or as a coefficient), dims direct light, is only evaluated (for
 * views and shaders of your own), or is not even loaded.
 */
export type Role = 'occlusion' | 'irradiance' | 'harmonics' | 'shadow' | 'value' | 'none'
/** What a vertex stores: two integers of 16 bits. */
export type Code = ArrayLike<number>

/** From stored values to the signal's unit, see {@link undo}. */
export interface Scale {
  /** The curve's value at a stored 0. */
  low: number
  /** The curve's value at a stored 1, less `low`. */
  extent: number
  /** The signal's value that is white; 0 for the linear curve. */
  white: number
}

/** One layer of a file. */
export interface Layer {
  index: number
  /** `ambientOcclusion`, `irradiance`, `shadow`, ... */
  signal: string
  /** The vertex attribute with the codes; in the profile texcoord the one that `prepare` makes of texture coordinates. */
  attribute: string
  channels: 1 | 2 | 3
  form: Form
  /**
   * In the profile texcoord, where vertices carry pairs of floats, the width and the rows of all pages in texels, at least 1; null where they
   * carry codes.
   */
  stack: [number, number] | null
  scale: Scale
  /** What the signal's values are clamped to after interpolation; null where they need none. */
  clamp: [number, number] | null
  /** Numbers of glTF textures. */
  pages: number[]
  /** Number of a glTF texture, for the form `table`. */
  table: number | null
  /** The object as it stands in the file. */
  info: Record<string, unknown>
}

export interface Lightmap {
  pageSize: [number, number]
  layers: Layer[]
  /** The root object as it stands in the file. */
  root: Record<string, unknown>
}

/** The extension's object of a primitive. */
export interface PrimitiveLight {
  /** An attribute per layer. */
  attributes: string[]
  /** The attribute that is the light for viewers without the extension. */
  fallback?: string
  /** Where the asset's own `COLOR_0` is kept. */
  color0?: string
}

/** The extension of a glTF; null without it, and where materials show the light (profiles stock and lightmap). Throws an `Error` that says what this reader does not know. */
export function readExtension(json: object): Lightmap | null
export function primitiveLight(primitive: object): PrimitiveLight | null
/** Changes a glTF for a viewer that shows the light: its own `COLOR_0` comes back, attributes are named as by the layers. */
export function prepare(json: object, layers: Layer[]): void
/** {@link prepare} for one primitive; once only. */
export function preparePrimitive(primitive: object, layers: Layer[]): void
/** What a layer does unless told otherwise: shadows do nothing, for nobody knows of which light they are. */
export function defaultRole(layer: Layer, layers: Layer[]): Role

/** Numbers of an image, row-major from the top, channels side by side. */
export interface Image {
  width: number
  height: number
  channels: number
  bits: 8 | 16
  data: Uint8Array | Uint16Array
}

export interface Atlas {
  size: [number, number]
  pages: Image[]
}

export function isColor(code: Code): boolean
export function colorBits(code: Code): number
/** The color of a color-vertex, in 0..1. */
export function color(code: Code, form: Form, table?: Image | null): number[]
export function vertex(
  code: Code,
  form: Form,
  table?: Image | null,
): { color: number[]; position: [number, number]; eta: number }
/** Pages as one stack; `size` is that of a page. Throws an `Error` where a page has another size. */
export function atlasView(size: [number, number], pages: Image[]): Atlas
/** The bilinear value at a place of the stack, in texels. */
export function lookup(atlas: Atlas, position: [number, number], channel: number): number
/** The stored value at a point of a triangle; `barycentric` are the weights of the second and third corner. */
export function decode(
  codes: [Code, Code, Code],
  barycentric: [number, number],
  atlas: Atlas,
  form: Form,
  table?: Image | null,
): number[]
/** The signal's value of a stored one. */
export function undo(unit: number, scale: Scale): number
/** The signal's value as it is shown: within `ends`, a layer's `clamp`. After {@link undo}, at the pixel. */
export function clamped(light: number, ends: [number, number] | null): number
export function scaleOf(layer: { curve?: string; range: [number, number]; white?: number }): Scale

export function isPng(bytes: Uint8Array): boolean
/** 8 or 16 bits, not interlaced, no palette; null for others. Throws an `Error` when the file is damaged. */
export function readPng(bytes: Uint8Array): Promise<Image | null>
/** As {@link readPng}; what it does not read is left to the browser. */
export function readImage(bytes: Uint8Array, mimeType?: string): Promise<Image>
/** Images of one size as the layers of one texture array. */
export function pack(
  images: Image[],
  channels: 1 | 4,
): { width: number; height: number; layers: number; channels: 1 | 4; half: boolean; data: Uint8Array | Uint16Array }

/** A layer as the GLSL needs it; `atlas` and `palette` are null without pages or table. */
export interface UsedLayer extends Layer {
  role: Role
  atlas: unknown
  palette: unknown
}

/** The name of a layer's attribute in shaders. */
export function attributeName(layer: { attribute: string }): string
/** What tells the programs of two lights apart. */
export function shaderKey(layers: UsedLayer[], view: UsedLayer | null): string
export function vertexDeclarations(layers: UsedLayer[]): string
export function vertexMain(layers: UsedLayer[]): string
export function fragmentDeclarations(layers: UsedLayer[]): string
export function fragmentMain(layers: UsedLayer[]): string
/** The first part of `fragmentMain`: asks for texels. The more stands between the two parts, the less a GPU waits. */
export function fragmentTexels(layers: UsedLayer[]): string
/** The second part of `fragmentMain`: what the layers show, and what their roles make of it. */
export function fragmentLight(layers: UsedLayer[]): string
/** Which coefficient of the harmonics a layer is, or null. */
export function harmonic(layer: { signal: string }): number | null
export function harmonicIrradiance(layers: UsedLayer[]): string
