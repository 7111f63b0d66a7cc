// Arm and safe stop. The session's token is in the address that `trocar up` prints, after #token=, which browsers never send.

import { order, unanswered } from "../command.js";
import { said, t } from "../school/i18n.js";

const $ = (id) => document.getElementById(id);

const COMMANDS = { arm: "api/arm", "safe-stop": "api/safe_stop" };

export class Controls {
  // `onToken(token)` is called with the session's token, or null, whenever the address names another.
  constructor(onToken) {
    this.onToken = onToken;
    for (const [id, path] of Object.entries(COMMANDS)) $(id).onclick = () => this.post($(id), path);
    addEventListener("keydown", (event) => {
      if (event.key === "Escape" && this.token) $("safe-stop").click();
    });
    addEventListener("hashchange", () => this.readAddress()); // an address with another token does not load the page anew
    this.readAddress();
  }

  readAddress() {
    this.token = new URLSearchParams(location.hash.slice(1)).get("token");
    const why = t("Open the address that trocar up printed, with its #token=…, to command the rig.");
    for (const id in COMMANDS) {
      $(id).disabled = !this.token;
      $(id).title = this.token ? "" : why;
    }
    $("safe-stop").title ||= t("Let both arms go limp (Escape)");
    this.say("");
    this.onToken(this.token);
  }

  async post(button, path) {
    button.disabled = true;
    try {
      const answer = await fetch(path, order(this.token));
      const refusal = answer.status === 401 || answer.status === 403
        ? t("The rig did not accept this page's token; open the address that trocar up printed.")
        : said((await answer.json().catch(() => null))?.error) || t("The rig answered with status {status}.", { status: answer.status });
      this.say(answer.ok ? "" : refusal);
    } catch (error) {
      this.say(said(unanswered(error, "The supervisor is not reachable: nothing was commanded.")));
    } finally {
      button.disabled = false;
    }
  }

  say(text) {
    $("rig-reason").textContent = text;
    $("rig-reason").dataset.own = text ? "yes" : "";
  }
}
