// The baked files that the tests look at: those of `make bake`, or of a folder named by LIGHTKILN_FILES.

import { readdirSync, readFileSync } from 'node:fs'
import { basename, join } from 'node:path'
import { fileURLToPath } from 'node:url'
import { EXTENSION } from 'lightkiln-format'
import { readGlb } from './glb.mjs'
import { addLayer } from './layers.mjs'

export const FOLDER = process.env.LIGHTKILN_FILES ?? fileURLToPath(new URL('../../out', import.meta.url))

export const bakedFiles = readdirSync(FOLDER)
  .filter((name) => name.endsWith('.glb') && readFileSync(join(FOLDER, name)).includes(EXTENSION))
  .sort()
  .map((name) => ({ name: basename(name, '.glb'), bytes: new Uint8Array(readFileSync(join(FOLDER, name))) }))

if (bakedFiles.length === 0) throw new Error(`no baked .glb in ${FOLDER}: run make bake`)

export const baked = (name) => bakedFiles.find((file) => file.name.startsWith(name)).bytes

/** A file with a layer of every kind that the format has, where its first layer is scalar; others as they are. */
export async function withAllForms(bytes) {
  const { layers: baked } = readGlb(bytes).json.extensions[EXTENSION]
  if (baked.length > 1 || baked[0].channels > 1) return bytes
  const layers = [
    { signal: 'irradiance', channels: 3, curve: 'log', range: [0, 1000], white: 500, of: (v) => [v, v * v, 1 - v] },
    { signal: 'shadow', channels: 1, curve: 'linear', range: [-0.25, 1.25], clamp: [0, 1], bits: 16, of: (v) => [1 - v] },
    { signal: 'bentNormal', channels: 3, curve: 'linear', range: [-1, 1], bits: 16, of: (v) => [v, 0.5, 1 - v * v] },
    { signal: 'texture', channels: 3, curve: 'linear', range: [0, 1], form: 'table', of: (v) => [1 - v, v, v * v * v] },
    { signal: 'direct', channels: 1, curve: 'linear', range: [0, 9], form: 'table', of: (v) => [v * v] },
  ]
  for (const layer of layers) bytes = await addLayer(bytes, layer)
  return bytes
}
