// Browsers refuse workers to pages that are opened as files. There the search runs in a hidden frame instead.
// Material's search asks for the name IFrameWorker, to find its own scripts.
if (location.protocol === "file:") {
  window.IFrameWorker = window.Worker = class extends EventTarget {
    constructor(url) {
      super()
      const address = new URL(url, location.href).href
      const frame = Object.assign(document.createElement("iframe"), { hidden: true })
      document.body.append(frame)
      this.frame = frame.contentWindow
      addEventListener("message", (event) => {
        if (event.source === this.frame) this.dispatchEvent(new MessageEvent("message", { data: event.data }))
      })
      const page = this.frame.document
      page.open()
      page.write(`<body><script>
        postMessage = (data) => parent.postMessage(data, "*")
        importScripts = (...scripts) => scripts.reduce((before, source) => before.then(() => new Promise((done) => {
          const script = document.createElement("script")
          script.src = source
          script.onload = done
          document.body.append(script)
        })), Promise.resolve())
      </script><script src="${address}"></script>`)
      page.close()
      this.ready = new Promise((done) => (frame.onload = done))
    }
    postMessage(data) {
      this.ready.then(() => this.frame.dispatchEvent(new MessageEvent("message", { data })))
    }
    terminate() {
      this.frame.frameElement.remove()
    }
  }
}
