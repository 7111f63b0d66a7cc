// What every command carries: the session's token, of which run of the rig it is, and up to when in the rig's own time.

const PATIENCE_MS = 3000;
let rig = null;

// To be told every state of the rig: its time is known from it.
export function hear({ incarnation, t }, now = performance.now()) {
  rig = { incarnation, t, now };
}

// Return what `fetch` wants for a command; nobody waits longer for it, so it is not carried out after that.
export function order(token, body, now = performance.now()) {
  const before = rig && `${rig.incarnation} ${(rig.t + (now - rig.now + PATIENCE_MS) / 1e3).toFixed(3)}`;
  const headers = { "X-Trocar-Token": token, ...(before && { "X-Trocar-Before": before }) };
  return { method: "POST", headers, body, signal: AbortSignal.timeout(PATIENCE_MS) };
}
