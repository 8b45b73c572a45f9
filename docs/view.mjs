// Screenshots of `lightkiln view`: FOLDER/view.png has the light as baked and by vertices alone, FOLDER/view_overlay.png the
// classification, both with the atlas.
//
//   node docs/view.mjs FILE.glb REPORT.json FOLDER

import { join } from 'node:path'
import { complaintsOf, launch, serve } from '../crates/page/browser/browser.mjs'

const [file, report, folder] = process.argv.slice(2)
if (folder === undefined) {
  console.error('usage: view.mjs FILE.glb REPORT.json FOLDER')
  process.exit(1)
}

/** What is chosen on the page, and what the pointer is over, in pixels. */
const SHOTS = {
  'view.png': { state: { materials: false, divider: 0.53 }, closer: 2.1, pointer: [512, 492] },
  'view_overlay.png': { state: { overlay: 'classes', divider: 1 }, closer: 2.1 },
}

const { url, stop } = await serve(['--trace', '20000', '--report', report, file])
const browser = await launch()
try {
  for (const [name, { state, closer, pointer }] of Object.entries(SHOTS)) {
    const page = await browser.newPage({ viewport: { width: 1120, height: 680 }, colorScheme: 'light' })
    const complaints = complaintsOf(page)
    await page.goto(url)
    await page.waitForFunction(() => globalThis.ready === true)
    await page.waitForLoadState('networkidle')
    await page.evaluate(([state, closer]) => {
      const { state: { camera }, set } = globalThis.lightkiln
      camera.closer(closer)
      camera.move(0, -0.09)
      set(state)
    }, [state, closer])
    if (pointer !== undefined) await page.mouse.move(...pointer, { steps: 2 })
    await page.evaluate(() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done))))
    await page.screenshot({ path: join(folder, name) })
    await page.close()
    if (complaints.length > 0) throw new Error(complaints.join('\n'))
  }
} finally {
  await browser.close()
  stop()
}
