// An extension of JupyterLab in one file, without a build step. Notebooks read well without it;
// it adds what only a program can do:
//
// - an answer (cells with the tag "answer", after one with the tag "answer-button") opens and
//   closes as a whole, by one click;
// - a number in the text, <span class="claim" title="its_name">, becomes the one that the reader's
//   own kernel has found, and is marked where it is not as claimed;
// - a fold of claims says how many hold, and a folded cell that fails unfolds.
(() => {
  const STYLE = `
    .lite-button { cursor: pointer; color: var(--jp-content-link-color); }
    .lite-button .jp-RenderedMarkdown strong::before { content: "▸ "; }
    .lite-button.lite-open .jp-RenderedMarkdown strong::before { content: "▾ "; }
    .lite-answer { border-left: 3px solid var(--jp-border-color1); }
    .lite-answer details.answer > summary { display: none; }
    .claim.lite-fails { color: var(--jp-error-color1); text-decoration: underline wavy; }
    .lite-hold { color: var(--jp-ui-font-color2); padding-left: 0.5em; }
    .jp-RenderedHTMLCommon img.picture, .jupyter-widgets img.picture { max-width: 100%; }
  `;

  const tagged = (cell, tag) => (cell.model.getMetadata("tags") ?? []).includes(tag);

  const outputsOf = (cell) => {
    const outputs = cell.model.type === "code" ? cell.model.outputs : null;
    return Array.from({ length: outputs?.length ?? 0 }, (_, k) => outputs.get(k));
  };

  class Reader {
    constructor(notebook) {
      this.notebook = notebook;
      this.open = new Set(); // the answers that are open, by their buttons' cells
      this.watched = new WeakSet();
      this.failed = new WeakSet(); // errors that have been shown: readers may fold them again
      const look = () => this.lookSoon();
      new MutationObserver(look).observe(notebook.node, { childList: true, subtree: true });
      notebook.model.cells.changed.connect(look);
      this.look();
    }

    lookSoon() {
      clearTimeout(this.timer);
      this.timer = setTimeout(() => this.look(), 100);
    }

    look() {
      const numbers = new Map();
      let button = null;
      for (const cell of this.notebook.widgets) {
        if (tagged(cell, "answer-button")) this.drawButton((button = cell));
        else if (tagged(cell, "answer")) this.drawAnswer(cell, button);
        else button = null;
        if (cell.model.type === "code") this.lookAtOutputs(cell, numbers, button);
      }
      this.fillIn(numbers);
    }

    drawButton(cell) {
      cell.node.classList.add("lite-button");
      cell.node.classList.toggle("lite-open", this.open.has(cell));
      if (this.watched.has(cell)) return;
      this.watched.add(cell);
      cell.node.setAttribute("role", "button");
      cell.node.addEventListener("click", () => this.turn(cell, !this.open.has(cell)));
    }

    turn(button, open) {
      if (open) this.open.add(button);
      else this.open.delete(button);
      const cells = this.notebook.widgets;
      for (let k = cells.indexOf(button) + 1; k < cells.length && tagged(cells[k], "answer"); k++) {
        if (open && cells[k].model.type === "code" && !tagged(cells[k], "claims")) {
          cells[k].outputHidden = false;
          cells[k].inputHidden = tagged(cells[k], "hide-input");
        }
      }
      this.look();
    }

    drawAnswer(cell, button) {
      if (!button) return;
      cell.node.classList.add("lite-answer");
      const hidden = !this.open.has(button);
      if (cell.isHidden !== hidden) cell.setHidden(hidden);
      for (const fold of cell.node.querySelectorAll("details.answer:not([open])")) fold.open = true;
    }

    lookAtOutputs(cell, numbers, button) {
      if (!this.watched.has(cell)) {
        this.watched.add(cell);
        cell.model.outputs.changed.connect(() => this.lookSoon());
      }
      const outputs = outputsOf(cell);
      const claims = outputs.filter((output) => output.metadata?.claim);
      for (const { metadata } of claims) {
        numbers.set(metadata.claim.name, { text: metadata.shown, holds: metadata.claim.holds });
      }
      if (tagged(cell, "claims")) {
        this.count(cell, claims);
        // One fold for code and values; JupyterLab unfolds the values of a cell that runs.
        if (cell.outputHidden !== cell.inputHidden) cell.outputHidden = cell.inputHidden;
      }
      for (const output of outputs) {
        if (output.type === "error" && !this.failed.has(output)) {
          this.failed.add(output);
          if (button) this.turn(button, true);
          cell.inputHidden = cell.outputHidden = false;
        }
      }
    }

    count(cell, claims) {
      const place = cell.node.querySelector(".jp-InputPlaceholder .jp-Placeholder-contentContainer");
      if (!place) return;
      const hold = claims.filter(({ metadata }) => metadata.claim.holds !== false).length;
      const text = claims.length ? `${hold} ${hold === 1 ? "claim holds" : "claims hold"}` : "claims";
      let label = place.querySelector(".lite-hold");
      if (!label) {
        label = document.createElement("span");
        label.className = "lite-hold";
        place.replaceChildren(label);
      }
      if (label.textContent !== text) label.textContent = text;
    }

    fillIn(numbers) {
      for (const span of this.notebook.node.querySelectorAll("span.claim[title]")) {
        const number = numbers.get(span.title);
        if (!number?.text) continue;
        if (span.textContent !== number.text) span.textContent = number.text;
        span.classList.toggle("lite-fails", number.holds === false);
      }
    }
  }

  const plugin = {
    id: "pypose-lite-lab:reader",
    autoStart: true,
    activate: (app) => {
      const style = document.createElement("style");
      style.textContent = STYLE;
      document.head.append(style);
      const met = new WeakSet();
      const meet = () => {
        for (const panel of app.shell.widgets("main")) {
          if (!panel.content?.model?.cells || met.has(panel)) continue;
          met.add(panel);
          panel.context.ready.then(() => new Reader(panel.content));
        }
      };
      app.shell.layoutModified.connect(meet);
      setInterval(meet, 1000); // a panel has no model before its file has come
    },
  };

  window._JUPYTERLAB ??= {};
  window._JUPYTERLAB["pypose-lite-lab"] = {
    init: () => undefined, // nothing is shared
    get: () => Promise.resolve(() => ({ __esModule: true, default: plugin })),
  };
})();
