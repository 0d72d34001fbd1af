// What the keys do.
import { byId, make } from "./dom.js";

const LIST = [
  ["V, D, X, M, U", "tools: select, draw, exclude, marker, push"],
  ["Wheel, pinch, + and -", "zoom at the pointer"],
  ["Drag, arrows", "move the slice (with Space: drag with any tool)"],
  ["Drag with the right button", "window (across) and level (up, down)"],
  ["Shift and the wheel", "next and previous slice of a folder or volume"],
  ["F, 1", "fit; one to one"],
  ["H (hold)", "hide all that is drawn, to see the ink"],
  ["N, P", "next and previous finding"],
  ["A", "accept the finding as it is"],
  ["K, Shift-K", "next and previous knot"],
  ["J, Shift-J", "next and previous marker"],
  ["Arrows, once selected", "move the knot or marker by a pixel (Shift: ten, Alt: a tenth)"],
  ["Del", "delete the knot or marker"],
  ["I", "insert a knot behind the selected one"],
  ["[ and ]", "cut the line before or behind the knot"],
  ["Click, drag, Space", "while drawing: add a point, or draw in one go; arrows move the cross"],
  ["Enter, C, Backspace, Esc", "while drawing: end, close, take back, cancel"],
  ["L", "look along the line, where it was not in view"],
  ["Ctrl-Z, Ctrl-Shift-Z", "undo and redo"],
  ["Esc, else", "end the tool, or select nothing"],
];
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
const ZOOM_STEP = 1.25;
const PAN_STEP_PX = 60;

export class Keys {
  constructor(app, view, { findings, approval, selection, tools, pointer }) {
    Object.assign(this, { app, view, findings, approval, selection, tools, pointer });
    this.stage = byId("stage");
    document.addEventListener("keydown", (event) => this.down(event));
    document.addEventListener("keyup", (event) => this.up(event));
    byId("help").addEventListener("click", () => byId("keys").showModal());
    for (const [key, words] of LIST) {
      byId("keys-list").append(make("dt", {}, make("kbd", {}, key)), make("dd", {}, words));
    }
  }

  down(event) {
    if (!this.app.state || document.querySelector("dialog[open]") || isTyping(event.target)) return;
    if (event.ctrlKey || event.metaKey) {
      this.undoOrRedo(event);
      return;
    }
    // Arrows, Space and the keys of a drawing belong to the slice, unless a control has the keyboard.
    const isOnSlice = event.target === this.stage || event.target === document.body;
    if ((isOnSlice && this.onSlice(event)) || this.anywhere(event)) event.preventDefault();
  }

  undoOrRedo(event) {
    const key = event.key.toLowerCase();
    if (key !== "z" && key !== "y") return;
    event.preventDefault();
    if (key === "y" || event.shiftKey) byId("redo").click();
    else byId("undo").click();
  }

  // Do what a key does on the slice; whether it does anything there.
  onSlice(event) {
    const isDrawing = this.tools.tool === "draw";
    if (event.key in ARROWS) this.arrow(event);
    else if (event.key === " ") this.pointer.isSpaceDown = true;
    else if (isDrawing && event.key === "Enter") this.tools.endDrawing(false);
    else if (isDrawing && event.key.toLowerCase() === "c") this.tools.endDrawing(true);
    else if (isDrawing && event.key === "Backspace") this.tools.takeBackClick();
    else return false;
    return true;
  }

  // Do what a key does wherever the keyboard is; whether it does anything.
  anywhere(event) {
    const direction = event.shiftKey ? -1 : 1;
    switch (event.key.toLowerCase()) {
      case "v": this.tools.choose("select"); break;
      case "d": this.tools.choose("draw"); break;
      case "x": this.tools.choose("box"); break;
      case "m": this.tools.choose("marker"); break;
      case "u": this.tools.choose("push"); break;
      case "f": this.view.fit(); break;
      case "1": byId("one").click(); break;
      case "+":
      case "=": this.view.setZoom(this.view.zoom * ZOOM_STEP); break;
      case "-": this.view.setZoom(this.view.zoom / ZOOM_STEP); break;
      case "h": this.stage.classList.add("plain"); break;
      case "n": this.findings.turn(1); break;
      case "p": this.findings.turn(-1); break;
      case "a": this.acceptFinding(); break;
      case "k": this.selection.nextKnot(direction); break;
      case "j": this.selection.nextMarker(direction); break;
      case "delete": this.selection.remove(); break;
      case "i": this.selection.insert(); break;
      case "[": this.selection.cut("start"); break;
      case "]": this.selection.cut("end"); break;
      case "l": this.approval.lookAlong(); break;
      case "?": byId("keys").showModal(); break;
      case "escape": this.tools.escape(); break;
      default: return false;
    }
    return true;
  }

  acceptFinding() {
    if (this.app.selected?.kind === "finding") this.findings.accept(this.app.selected.key);
  }

  // Move the cross of a tool, or what is selected, or the slice.
  arrow(event) {
    let step = 1;
    if (event.shiftKey) step = 10;
    else if (event.altKey) step = 0.1;
    const [du, dv] = ARROWS[event.key];
    if (this.tools.tool !== "select") this.tools.moveCross(step * du, step * dv);
    else if (this.selection.place()) this.selection.nudge(step * du, step * dv);
    else this.view.pan(-PAN_STEP_PX * du, -PAN_STEP_PX * dv);
  }

  up(event) {
    if (event.key.toLowerCase() === "h") this.stage.classList.remove("plain");
    if (event.key !== " " || !this.pointer.isSpaceDown) return;
    this.pointer.isSpaceDown = false;
    const { cross, tool } = this.tools;
    if (cross && !this.pointer.drag && tool !== "select") this.tools.click(cross);
  }
}

// Whether keys go into a text and are no commands.
function isTyping(target) {
  const field = target.closest("input, textarea, select");
  return field !== null && field.type !== "checkbox" && field.type !== "range";
}
