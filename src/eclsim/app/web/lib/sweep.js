// The sweep of the monitor: where its head is, and which samples of a periodic waveform are seen where.
export const SECONDS = 6; // from the left to the right edge
export const LEFT = 40; // px of the axis

// Where the head is after some time [s], on a border of device pixels, so that pieces meet without a seam.
export function headAt(time, width, ratio) {
  const x = LEFT + ((time % SECONDS) * (width - LEFT)) / SECONDS;
  return Math.floor(x * ratio) / ratio;
}

// The samples of a waveform between two places [px], each at its own time, two beyond either end.
// Every sample is drawn where it belongs, between pixels too, so that all beats of a steady beat look alike.
export function samples(wave, period, width, from, to) {
  const step = (((width - LEFT) / SECONDS) * period) / wave.length;
  const first = Math.max(0, Math.floor((from - LEFT) / step) - 2);
  const points = [];
  for (let i = first; i <= Math.ceil((to - LEFT) / step) + 2; i += 1) {
    const value = wave[i % wave.length];
    if (Number.isFinite(value)) points.push([LEFT + i * step, value]);
  }
  return points;
}
