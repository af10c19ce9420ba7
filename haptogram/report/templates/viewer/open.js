// Opens the view: on the scene that the page holds, else on the frames of a board that runs.

const PAUSE_MS = 50; // 20 pictures a second at most
const CALM_MS = 1000; // for somebody who asked the system for little motion
const RETRY_MS = 1000;

async function openViewer() {
  const root = document.getElementById("viewer");
  const embedded = document.getElementById("scene");
  try {
    if (embedded) show(root, await unpackEmbedded(embedded.textContent.trim()), false);
    else await follow(root);
    followAddress(root);
    addEventListener("hashchange", () => followAddress(root));
  } catch (error) {
    root.dataset.ready = "false";
    tell(root, `This browser cannot show the view: ${error.message}`);
  }
}

function show(root, scene, isLive) {
  window.haptogramViewer = new Viewer(root, scene, isLive); // for tests and for the curious
}

function pauseMs() {
  return matchMedia("(prefers-reduced-motion: reduce)").matches ? CALM_MS : PAUSE_MS;
}

// An address that ends in #view-12 shows frame 12; so does #frame-12, if no table of the page lists that frame.
function followAddress(root) {
  const [, kind, number] = /^#(view|frame)-(\d+)$/.exec(location.hash) ?? [];
  if (!number || !window.haptogramViewer) return;
  if (kind === "frame" && document.getElementById(`frame-${number}`)) return;
  window.haptogramViewer.showNumber(Number(number));
  root.scrollIntoView();
}

function tell(root, text) {
  root.querySelector("[data-part=failure]").textContent = text;
}

// The next frames are asked for when the last ones are drawn: a slow page skips, and holds nobody up.
async function follow(root) {
  root.querySelector("[data-part=live]").hidden = false;
  for (let shown = null, ended = false; !ended; ) {
    const scene = await framesAfter(shown);
    if (scene) {
      ({ shown, ended } = scene.header);
      take(root, scene); // the array is there before the first frame
      tell(root, ended ? "The board has ended." : shown ? "" : "Nothing has been radiated yet.");
    } else {
      tell(root, "No connection to the board; what came is kept.");
    }
    await new Promise((resume) => { setTimeout(resume, scene ? pauseMs() : RETRY_MS); });
  }
}

function take(root, scene) {
  if (!window.haptogramViewer) show(root, scene, true);
  else if (scene.frames) window.haptogramViewer.append(scene);
}

async function framesAfter(shown) {
  try {
    // The first answer comes at once, with the array at least; the next ones wait for frames.
    const answer = await fetch(shown === null ? "frames" : `frames?after=${shown}`);
    return answer.ok ? unpackScene(await answer.arrayBuffer()) : null;
  } catch {
    return null;
  }
}

openViewer();
