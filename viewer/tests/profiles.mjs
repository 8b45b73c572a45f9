// The files of `make bake-profiles`.

import { readdirSync, readFileSync } from 'node:fs'
import { join } from 'node:path'
import { fileURLToPath } from 'node:url'

const FOLDER = process.env.LIGHTKILN_PROFILES ?? fileURLToPath(new URL('../../out/profiles', import.meta.url))

const PROFILES = ['eta', 'stock', 'texcoord', 'lightmap']
const named = (name, profile) => new Uint8Array(readFileSync(join(FOLDER, `${name}.${profile}.glb`)))

/** Scenes baked in all of these profiles, by `make bake-profiles`. */
export const profileFiles = readdirSync(FOLDER)
  .filter((file) => file.endsWith('.stock.glb'))
  .map((file) => file.slice(0, -'.stock.glb'.length))
  .map((name) => ({ name, ...Object.fromEntries(PROFILES.map((profile) => [profile, named(name, profile)])) }))

if (profileFiles.length === 0) throw new Error(`no .stock.glb in ${FOLDER}: run make bake-profiles`)
