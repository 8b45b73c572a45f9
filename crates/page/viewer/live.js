// Follows a bake: says what it is doing, takes the wish to stop it, and tells when there is something new to see.

const STAGES = {
  read: 'reading the scene', weld: 'welding vertices', sample: 'choosing samples', light: 'tracing light', filter: 'filtering light',
  fit: 'fitting vertices', classify: 'classifying triangles', check: 'checking', close: 'closing regions', chart: 'cutting charts',
  texel: 'tracing texels', pack: 'packing the atlas', encode: 'encoding', write: 'writing the file', verify: 'measuring errors',
}

/**
 * - `box`: the element that shows the bake
 * - `renew`: fetches and shows the newest model, unless a signal ends it
 * - `failed`: takes the error when that cannot be done
 */
export function follow(box, renew, failed) {
  const [text, meter, button] = ['p', 'progress', 'button'].map((name) => box.querySelector(name))
  const events = new EventSource('events')
  let [shown, busy, latest, lost] = [0, false, undefined, false]
  // A bake that has ended without a file has nothing more to show, and nobody is there to be asked.
  const over = new AbortController()
  box.hidden = false

  /** One model after the other, and of those that came meanwhile only the newest. */
  async function catchUp() {
    if (busy) return
    busy = true
    try {
      while (shown < latest.version && !over.signal.aborted) {
        const { version } = latest
        await renew(over.signal)
        shown = version
      }
    } catch (error) {
      if (!over.signal.aborted) failed(error)
    } finally {
      busy = false
    }
    say()
  }

  function say() {
    const { phase, stage, share, message } = latest
    const working = phase === 'baking' || phase === 'verifying'
    box.dataset.phase = lost ? 'failed' : phase
    box.dataset.shown = shown
    text.textContent = lost && working ? 'The program that bakes is gone.' : {
      baking: STAGES[stage] ?? stage,
      verifying: `the file is written: ${STAGES[stage] ?? stage}`,
      done: message ? `Done: ${message}.` : 'Done: this is the file.',
      cancelled: 'Cancelled: nothing was written.',
      failed: `The bake failed: ${message}.`,
    }[phase]
    meter.hidden = !working || lost
    // A stage that does not say how far it is has a bar without an end.
    if (share > 0) meter.value = share
    else meter.removeAttribute('value')
    button.hidden = phase !== 'baking' || lost
  }

  events.addEventListener('message', (event) => {
    lost = false
    latest = JSON.parse(event.data)
    // A page of a finished file stays connected, so that it is served.
    if (latest.phase === 'cancelled' || latest.phase === 'failed') {
      events.close()
      over.abort()
    }
    say()
    catchUp()
  })
  events.addEventListener('error', () => {
    lost = true
    if (latest) say()
    else text.textContent = 'The program that bakes is gone.'
  })
  button.addEventListener('click', () => {
    button.disabled = true
    fetch('cancel', { method: 'POST' })
  })
}
