// What a trial's cameras saw at the time of its replay; brought when somebody wants to see it.

export function camerasIn(details, redraw) {
  const shown = { at: () => {} };
  details.hidden = false;
  details.addEventListener("toggle", () => bring(details).then((at) => { shown.at = at; redraw(); }, (error) => details.append(`They cannot be shown: ${error.message}`)), { once: true });
  return shown;
}

async function bring(details) {
  const answer = await fetch(details.dataset.source);
  if (!answer.ok) throw new Error(`the farm answers ${answer.status}`);
  const bytes = await answer.arrayBuffer(), length = new DataView(bytes).getUint32(0, true);
  const { cameras, images } = JSON.parse(new TextDecoder().decode(new Uint8Array(bytes, 4, length)));
  const views = cameras.map((name, camera) => {
    const canvas = document.createElement("canvas"), figure = document.createElement("figure"), caption = document.createElement("figcaption");
    figure.append(canvas, caption);
    details.querySelector(".cameras").append(figure);
    return { name, canvas, caption, images: images.filter(([of]) => of === camera), image: null };
  });
  return (time) => views.forEach((view) => show(view, time, bytes, 4 + length));
}

// The last image that was exposed by then.
async function show(view, time, bytes, begin) {
  const image = view.images.findLast(([, at]) => at <= time) ?? view.images[0];
  if (!image || view.image === image) return;
  view.image = image;
  const [, at, first, size] = image, { canvas } = view;
  const picture = await createImageBitmap(new Blob([new Uint8Array(bytes, begin + first, size)], { type: "image/jpeg" }));
  if (view.image !== image) return;
  [canvas.width, canvas.height] = [picture.width, picture.height];
  canvas.getContext("2d").drawImage(picture, 0, 0);
  canvas.dataset.time = at.toFixed(3);
  view.caption.textContent = `${view.name}, ${at.toFixed(2)} s`;
}
