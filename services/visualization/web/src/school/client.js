// Requests to the school, with the session's token; an answer that is no success is an Error with the school's sentence,
// in the language chosen.

import { said, t } from "./i18n.js";

export class School {
  constructor() {
    this.token = null;
  }

  async ask(path, { method = "GET", body, raw = false } = {}) {
    if (!this.token) throw new Error(t("Open the address that trocar up printed, with its #token=…."));
    const options = { method, headers: { "X-Trocar-Token": this.token }, cache: "no-store" };
    if (body !== undefined) options.body = body instanceof Blob || body instanceof Uint8Array ? body : JSON.stringify(body);
    const answer = await fetch(`school/${path}`, options);
    if (!answer.ok) throw new Error(said((await answer.json().catch(() => null))?.error) || t("The rig answered with status {status}.", { status: answer.status }));
    return raw ? answer : answer.json();
  }

  post(path, body = {}) {
    return this.ask(path, { method: "POST", body });
  }
}
