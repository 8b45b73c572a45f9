// What the tests of the page share: the program, and a headless browser.

import { existsSync } from 'node:fs'
import { createRequire } from 'node:module'
import { join } from 'node:path'
import { fileURLToPath } from 'node:url'

export const ROOT = fileURLToPath(new URL('../../..', import.meta.url))
export const PROGRAM = process.env.LIGHTKILN ?? join(ROOT, 'target/release/lightkiln')
const { chromium } = createRequire(join(ROOT, 'viewer/package.json'))('playwright-core')

export function launch() {
  const known = [process.env.CHROMIUM, '/usr/bin/chromium', '/usr/bin/chromium-browser', '/usr/bin/google-chrome']
  const executablePath = known.find((path) => path && existsSync(path))
  const args = ['--no-sandbox', '--use-gl=angle', '--use-angle=swiftshader', '--enable-unsafe-swiftshader', '--hide-scrollbars']
  return chromium.launch({ executablePath, args })
}
