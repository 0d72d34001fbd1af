"use strict";
// Shows the newest frame, and answers when it is drawn: the program waits for that and measures how long it took.
(function () {
  const connection = document.getElementById("connection"), latency = document.getElementById("latency");
  const canvas = document.getElementById("picture"), QUIET_S = 1;
  let drawn = 0, open = true;

  function say(kind, words) {
    if (connection.textContent !== words) { connection.className = "verdict " + kind; connection.textContent = words; }
  }
  const socket = new WebSocket("ws://" + location.host + "/frames?token=" + location.hash.slice(1));
  let words = {};
  socket.onmessage = async (event) => {
    if (typeof event.data === "string") { words = JSON.parse(event.data); return; }
    const picture = await createImageBitmap(event.data);
    canvas.width = picture.width; canvas.height = picture.height;
    canvas.getContext("2d").drawImage(picture, 0, 0);
    drawn = performance.now();
    say(words.refused ? "fail" : "pass", words.refused ? "no wall: " + words.refused : "wall shown");
    latency.textContent = "frame " + words.frame + (words.latency_ms === null ? "" : ", shown " + words.latency_ms.toFixed(0) + " ms after it came");
    socket.send(String(words.frame));
  };
  socket.onclose = () => { open = false; say("fail", "the program has ended: what is shown is old"); };
  setInterval(() => {
    const quiet = Math.floor((performance.now() - drawn) / 1000);
    if (open && drawn && quiet >= QUIET_S) say("fail", "no frame has come for " + quiet + " s: what is shown is old");
  }, 250);
})();
