// lightkiln-format as a viewer of one's own would use it, with types.

import {
  EXTENSION, VERSION, atlasView, clamped, decode, defaultRole, fragmentDeclarations, fragmentMain, prepare, readExtension,
  readPng, undo, vertexMain, type Code, type Role, type UsedLayer,
} from 'lightkiln-format'

export async function value(json: object, png: Uint8Array, codes: [Code, Code, Code]): Promise<number[]> {
  const lightmap = readExtension(json)
  const page = await readPng(png)
  if (lightmap === null || page === null) throw new Error(`no ${EXTENSION} ${VERSION}`)
  prepare(json, lightmap.layers)
  const [layer] = lightmap.layers
  if (layer === undefined) return []
  const role: Role = defaultRole(layer, lightmap.layers)
  const used: UsedLayer[] = [{ ...layer, role, atlas: page, palette: null }]
  console.log(vertexMain(used), fragmentDeclarations(used), fragmentMain(used))
  return decode(codes, [0.2, 0.3], atlasView(lightmap.pageSize, [page]), layer.form)
    .map((unit) => clamped(undo(unit, layer.scale), layer.clamp))
}
// @ts-expect-error a code has no letters
value({}, new Uint8Array(), ['a', 'b', 3])
