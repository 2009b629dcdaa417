// Sweep of the monitor: position of its head, and positions of the samples of a periodic waveform.
export const SECONDS = 6; // from the left to the right edge
export const LEFT = 40; // px of the axis

// Position of the head after a time [s], on a device pixel boundary, so that pieces join without a seam.
export function headAt(time, width, ratio) {
  const x = LEFT + ((time % SECONDS) * (width - LEFT)) / SECONDS;
  return Math.floor(x * ratio) / ratio;
}

// Samples of a waveform between two positions [px], each at its own time, two beyond either end.
// Samples are drawn at their exact positions, also between pixels, so that repeated beats look identical.
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
