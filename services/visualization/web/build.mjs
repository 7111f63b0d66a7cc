// Bundles the page into dist/: one script, one style sheet, one document, nothing from elsewhere.
import { build } from "esbuild";
import { cp, mkdir, rm } from "node:fs/promises";
import { fileURLToPath } from "node:url";

const here = (path) => fileURLToPath(new URL(path, import.meta.url));

await rm(here("dist"), { recursive: true, force: true });
await mkdir(here("dist"), { recursive: true });
await build({
  entryPoints: { app: here("src/main.js"), style: here("src/style.css") },
  outdir: here("dist"),
  bundle: true,
  format: "esm",
  target: "es2022",
  minify: true,
  legalComments: "linked",
  logLevel: "info",
});
await cp(here("src/index.html"), here("dist/index.html"));
await cp(here("src/icon.svg"), here("dist/icon.svg"));
