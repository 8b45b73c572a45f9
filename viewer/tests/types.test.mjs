// The types of all packages: they are valid, a user's code passes with them, and they name what there is.

import assert from 'node:assert/strict'
import { execFile } from 'node:child_process'
import { readFileSync } from 'node:fs'
import { test } from 'node:test'
import { fileURLToPath } from 'node:url'
import { promisify } from 'node:util'

const path = (name) => fileURLToPath(new URL(name, import.meta.url))

test('tsc has nothing to say about the packages and code that uses them', async () => {
  const run = promisify(execFile)(process.execPath, [path('../node_modules/typescript/bin/tsc'), '-p', path('types')])
  const { stdout } = await run.catch((error) => error)
  // The engines' own types may disagree with each other; what begins with their folder is not ours to mend.
  assert.deepEqual(stdout.split('\n').filter((line) => line !== '' && !/^(node_modules| )/.test(line)), [])
})

const MODULES = ['lightkiln-format/index', 'three-lightkiln/index', 'three-lightkiln/webgpu', 'babylon-lightkiln/index', 'gltf-transform-lightkiln/index']
for (const module of MODULES) {
  test(`${module}.d.ts names what ${module}.js exports`, async () => {
    const declared = readFileSync(path(`../${module}.d.ts`), 'utf8').matchAll(/^export (?:const|function|class) (\w+)/gm)
    assert.deepEqual([...declared].map(([, name]) => name).sort(), Object.keys(await import(path(`../${module}.js`))).sort())
  })
}
