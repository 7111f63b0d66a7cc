// The fields of every command: the session's token, the run of the rig, and an expiry in the rig's own time.

const PATIENCE_MS = 3000;
let rig = null;

// Takes every state of the rig, from which the rig's time follows.
export function hear({ incarnation, t }, now = performance.now()) {
  rig = { incarnation, t, now };
}

// Returns what to say of a command that `fetch` brought no answer to: `unsent` if the rig has not heard it.
export function unanswered(error, unsent) {
  if (error?.name !== "TimeoutError") return unsent;
  return "The rig has not answered in time: its state tells whether this was done.";
}

// Returns the options of `fetch` for a command, which the rig must not carry out after `fetch` has timed out.
export function order(token, body, now = performance.now()) {
  const before = rig && `${rig.incarnation} ${(rig.t + (now - rig.now + PATIENCE_MS) / 1e3).toFixed(3)}`;
  const headers = { "X-Trocar-Token": token, ...(before && { "X-Trocar-Before": before }) };
  return { method: "POST", headers, body, signal: AbortSignal.timeout(PATIENCE_MS) };
}
