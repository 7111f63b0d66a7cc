const LOCAL = new Set(["127.0.0.1", "localhost", "[::1]", "0.0.0.0", "[::]"]);

// The address of the view's WebSocket for a page at `location`: a rig that names itself by a loopback address
// is reached under the name of the page (a tunnel, a container, another computer).
export function viewAddress(announced, location) {
  const url = new URL(announced || "ws://127.0.0.1:8081/ws");
  if (LOCAL.has(url.hostname)) url.hostname = location.hostname;
  if (location.protocol === "https:") url.protocol = "wss:";
  return url.href;
}
