// A finished run, whose data is all in the page.

async function showRun() {
  const player = makePlayer();
  player.begin(await unpack(data.series));
  player.seek(data.start);
  player.zoom(true);
  document.documentElement.dataset.ready = "yes";
}

showRun().catch(complain);
