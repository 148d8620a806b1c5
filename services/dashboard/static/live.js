// Renews the parts of a page that the server sends anew, and keeps the keyboard's focus where it was.

const REFUSED_PAUSE_MS = 1500;
const address = document.body.dataset.live;
const lost = document.querySelector(".link-lost");

export const ZONED = new Intl.DateTimeFormat("sv-SE", { year: "numeric", month: "2-digit", day: "2-digit", hour: "2-digit", minute: "2-digit", second: "2-digit", timeZoneName: "shortOffset" });

// Moments in the reader's own time zone, with its offset.
function localised(element) {
  for (const time of element.querySelectorAll("time[datetime]")) {
    const at = new Date(time.dateTime);
    time.title = time.title || time.textContent;
    if (!Number.isNaN(at.getTime())) time.textContent = ZONED.format(at).replace("GMT", "UTC");
  }
}

const alike = (old, made) => old?.nodeType === made.nodeType && old.nodeName === made.nodeName && old.id === made.id;

function passed(node) {
  const next = node.nextSibling;
  node.remove();
  return next;
}

// Makes an element like another, and leaves what its reader did: an open menu, typed words, the focus, how far it is scrolled.
function become(old, made) {
  if (old.isEqualNode(made)) return;
  if (old.nodeType === Node.TEXT_NODE) old.data = made.data;
  if (old.nodeType !== Node.ELEMENT_NODE) return;
  for (const { name } of [...old.attributes]) if (name !== "open" && !made.hasAttribute(name)) old.removeAttribute(name);
  for (const { name, value } of made.attributes) old.setAttribute(name, value);
  let next = old.firstChild;
  for (const child of [...made.childNodes]) {
    const same = child.id ? [...old.children].find(({ id }) => id === child.id) : next;
    if (!alike(same, child)) {
      old.insertBefore(child, next);
      continue;
    }
    while (next !== same) next = passed(next);
    next = same.nextSibling;
    become(same, child);
  }
  while (next) next = passed(next);
}

function renew(name, html) {
  const element = document.getElementById(name);
  if (!element || element.dataset.part === undefined) return;
  const made = element.cloneNode(false);
  made.innerHTML = html;
  localised(made);
  const focused = element.contains(document.activeElement) ? document.activeElement.id : "";
  become(element, made);
  if (focused && document.activeElement.id !== focused) document.getElementById(focused)?.focus({ preventScroll: true });
}

function follow() {
  const source = new EventSource(address);
  source.addEventListener("open", () => (lost.hidden = true));
  source.addEventListener("error", () => {
    lost.hidden = false;
    // The server answered and gave no stream: the page itself will say why, perhaps that one must sign in again.
    if (source.readyState === EventSource.CLOSED) setTimeout(() => location.reload(), REFUSED_PAUSE_MS);
  });
  source.addEventListener("parts", (event) => {
    for (const [name, html] of Object.entries(JSON.parse(event.data))) renew(name, html);
    document.body.dataset.renewed = String(Number(document.body.dataset.renewed ?? 0) + 1);
  });
  source.addEventListener("anew", () => {
    source.close();
    location.reload();
  });
  // A page that was left needs no stream; one that the browser brings back as it was needs a new one.
  addEventListener("pagehide", () => source.close(), { once: true });
  addEventListener("pageshow", (event) => event.persisted && location.reload(), { once: true });
}

for (const button of document.querySelectorAll("[data-copies]"))
  button.addEventListener("click", () => {
    const source = document.getElementById(button.dataset.copies);
    source.select?.();
    navigator.clipboard?.writeText(source.value ?? source.textContent).then(() => (button.textContent = "Copied"), () => {});
  });
localised(document);
if (address) follow();
