import type { Layer, Light, NodeSupport } from './index.js'
import type { Node } from 'three/webgpu'

/** For the option `nodes` of LightkilnPlugin, with WebGPURenderer. */
export const lightkilnNodes: NodeSupport
/** A loaded layer as a node of three numbers as stored, in 0..1; gray for scalar layers. */
export function storedLight(layer: Light['layers'][number]): Node
/** A loaded layer as a node, in the signal's unit. */
export function light(layer: Light['layers'][number]): Node
export type { Layer }
