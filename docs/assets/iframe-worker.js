// Search in pages that were opened from a folder. Browsers start no worker from a file: the search then
// runs in a hidden frame, which is given the worker's messages.
if (location.protocol === "file:") {
  window.Worker = class extends EventTarget {
    constructor(url) {
      super()
      const frame = document.createElement("iframe")
      frame.hidden = true
      document.body.appendChild(frame)
      this.frame = frame
      window.addEventListener("message", (event) => {
        if (event.source !== frame.contentWindow) return
        const message = new MessageEvent("message", { data: event.data })
        this.dispatchEvent(message)
        if (this.onmessage) this.onmessage(message)
      })
      this.ready = new Promise((loaded) => { frame.onload = loaded })
      const inside = frame.contentDocument
      inside.open()
      inside.write(
        "<script>self.postMessage = (data) => parent.postMessage(data, '*')</" + "script>" +
        "<script src='" + url + "'></" + "script>"
      )
      inside.close()
    }

    postMessage(data) {
      this.ready.then(() => {
        this.frame.contentWindow.dispatchEvent(new MessageEvent("message", { data }))
      })
    }

    terminate() {
      this.frame.remove()
    }
  }
}
