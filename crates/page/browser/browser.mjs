// What the tests of the page share: the program, and the headless browser of viewer/.

import { join } from 'node:path'
import { fileURLToPath } from 'node:url'

import { launch as chromium } from '../../../viewer/tests/browser.mjs'

export { complaintsOf } from '../../../viewer/tests/browser.mjs'

export const ROOT = fileURLToPath(new URL('../../..', import.meta.url))
export const PROGRAM = process.env.LIGHTKILN ?? join(ROOT, 'target/release/lightkiln')

export const launch = () => chromium(['--hide-scrollbars'])
