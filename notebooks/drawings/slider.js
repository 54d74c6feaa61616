// Puts a slider below a moving picture: the reader chooses the frame. It works where scripts run (a live notebook, the
// book). Elsewhere the picture moves by itself.
(() => {
  const waiting = (milliseconds) => new Promise((done) => setTimeout(done, milliseconds));

  // The picture that stands right before the place of the slider, in the same cell's output.
  async function pictureBefore(place) {
    for (let attempt = 0; attempt < 40; attempt += 1) {
      const output = place.closest(".jp-OutputArea, .cell_output");
      const pictures = output ? [...output.querySelectorAll("img")] : [];
      const before = pictures.filter((picture) => picture.compareDocumentPosition(place) & Node.DOCUMENT_POSITION_FOLLOWING);
      if (before.length > 0) return before.at(-1);
      await waiting(250);
    }
    return null;
  }

  async function attach(place) {
    const picture = await pictureBefore(place);
    if (!picture || !("ImageDecoder" in window)) return;
    const content = await (await fetch(picture.src)).arrayBuffer();
    const decoder = new ImageDecoder({ data: content, type: "image/png" });
    await decoder.tracks.ready;
    await decoder.completed;
    const count = decoder.tracks.selectedTrack.frameCount;

    const canvas = document.createElement("canvas");
    canvas.style.maxWidth = "100%";
    canvas.setAttribute("role", "img");
    canvas.setAttribute("aria-label", picture.alt);
    canvas.style.display = "none";
    picture.after(canvas);

    const slider = document.createElement("input");
    Object.assign(slider, { type: "range", min: 0, max: count - 1, value: 0 });
    slider.setAttribute("aria-label", "frame of the moving picture");
    slider.style.width = "min(24em, 60%)";
    const button = document.createElement("button");
    button.textContent = "play";
    const number = document.createElement("span");
    number.textContent = " drag to choose a frame";
    place.append(slider, " ", button, number);

    const move = (moves) => {
      picture.style.display = moves ? "" : "none";
      canvas.style.display = moves ? "none" : "";
    };
    slider.oninput = async () => {
      const { image } = await decoder.decode({ frameIndex: Number(slider.value) });
      canvas.width = image.displayWidth;
      canvas.height = image.displayHeight;
      canvas.getContext("2d").drawImage(image, 0, 0);
      image.close();
      number.textContent = ` frame ${Number(slider.value) + 1} of ${count}`;
      move(false);
    };
    button.onclick = () => {
      number.textContent = "";
      move(true);
    };
  }

  for (const place of document.querySelectorAll(".gem-slider:not([data-ready])")) {
    place.dataset.ready = "yes";
    attach(place);
  }
})();
