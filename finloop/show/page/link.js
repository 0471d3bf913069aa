// The connection of a page to its server; it comes back by itself.

const $ = id => document.getElementById(id);
function set(id, text) { const at = $(id); if (at.textContent !== text) at.textContent = text; }

class Link {
  // path: of the WebSocket. heard(data, ms): a message came; opened(); closed(code, reason); again:
  // ms until the next try.
  constructor(path, {heard, opened = () => {}, closed = () => {}, again = 1000}) {
    Object.assign(this, {path, heard, opened, closed, again});
    this.connect();
  }

  get isOpen() { return this.socket.readyState === WebSocket.OPEN; }

  connect() {
    this.socket = new WebSocket(`ws://${location.host}${this.path}${location.search}`);
    this.socket.binaryType = "arraybuffer";
    this.socket.onmessage = event => this.heard(event.data, performance.now());
    this.socket.onopen = () => this.opened();
    this.socket.onclose = event => { this.closed(event.code, event.reason); setTimeout(() => this.connect(), this.again); };
  }

  // Send bytes, or an object as JSON; whether there is a connection.
  tell(message) {
    if (!this.isOpen) return false;
    this.socket.send(message instanceof Uint8Array ? message : JSON.stringify(message));
    return true;
  }
}

// The JSON of a message of `pack_message`, and its payload.
function unpack(data) {
  const length = new DataView(data).getUint32(0, true);
  return [JSON.parse(new TextDecoder().decode(new Uint8Array(data, 4, length))), data.slice(4 + length)];
}
