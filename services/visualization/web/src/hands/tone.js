// Force as a tone, for hands without force feedback: higher and louder with more newtons, silent without contact.

const BASE_HZ = 180, HZ_PER_N = 240, FULL_N = 3, LOUDEST = 0.08, GLIDE_S = 0.03;

export function pitchOf(newton) {
  return BASE_HZ + HZ_PER_N * Math.min(newton, FULL_N);
}

export function loudnessOf(newton) {
  return newton < 0.01 ? 0 : LOUDEST * Math.sqrt(Math.min(1, newton / FULL_N));
}

export class Tone {
  switch(on) {
    if (on && !this.context) this.start();
    this.on = on;
    if (!on) this.sound(0);
  }

  start() {
    this.context = new AudioContext();
    this.gain = new GainNode(this.context, { gain: 0 });
    this.voice = new OscillatorNode(this.context, { type: "triangle", frequency: BASE_HZ });
    this.voice.connect(this.gain).connect(this.context.destination);
    this.voice.start();
  }

  sound(newton) {
    if (!this.context) return;
    const now = this.context.currentTime;
    this.gain.gain.setTargetAtTime(this.on ? loudnessOf(newton) : 0, now, GLIDE_S);
    this.voice.frequency.setTargetAtTime(pitchOf(newton), now, GLIDE_S);
  }
}
