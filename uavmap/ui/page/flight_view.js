// The flight as the browser shows it: one canvas for the map, one for the latest picture, a table of
// the aircraft, the figures, the log. It is told by two methods: `setting` once, `take` for each
// change.

import { FlightMap } from "flight_map";

const SILENT_S = 6;

const clock = (seconds) => {
  if (seconds === null || seconds === undefined) return "";
  const s = Math.max(0, Math.round(seconds));
  const two = (n) => String(n).padStart(2, "0");
  const hours = Math.floor(s / 3600);
  return (hours ? hours + ":" : "") + two(Math.floor(s / 60) % 60) + ":" + two(s % 60);
};

// --- the page -----------------------------------------------------------------------------------
export default {
  template: `
  <div class="flight">
    <div class="flight-banner" v-if="banner" role="alert">{{ banner }}</div>
    <div class="flight-map">
      <canvas ref="map" tabindex="0" aria-label="map of the flight"></canvas>
      <button class="flight-fit" type="button" @click="fit">whole map</button>
      <ul class="flight-legend" v-if="scene">
        <li v-for="[name, colour] in scene.states" :key="name">
          <span :style="{ background: colour }"></span>{{ name }}
        </li>
        <li v-for="line in scene.lines" :key="line.name">
          <i :style="{ borderColor: line.colour }"></i>{{ line.name }}
        </li>
      </ul>
    </div>
    <div class="flight-side">
      <dl class="flight-figures">
        <template v-for="[name, value] in figures" :key="name">
          <dt>{{ name }}</dt><dd>{{ value }}</dd>
        </template>
      </dl>
      <div class="flight-scroll" v-if="rows.length">
      <table class="flight-vehicles">
        <thead><tr><th></th><th>doing</th><th>up</th><th>battery</th><th>left</th><th>sorties</th></tr></thead>
        <tbody>
          <tr v-for="row in rows" :key="row.number" :class="row.phase">
            <td><span class="flight-dot" :style="{ background: row.colour }">{{ row.number }}</span></td>
            <td>{{ row.doing }}</td>
            <td>{{ row.up }} m</td>
            <td :class="{ low: row.battery < 25 }">
              <span class="flight-bar"><i :style="{ width: row.battery + '%' }"></i></span>{{ Math.round(row.battery) }} %
            </td>
            <td>{{ row.left }}</td>
            <td>{{ row.sorties }}</td>
          </tr>
        </tbody>
      </table>
      </div>
      <figure class="flight-picture">
        <canvas ref="picture" v-show="pictured"></canvas>
        <figcaption>{{ caption }}</figcaption>
      </figure>
      <figure class="flight-picture" v-if="judged">
        <img :src="judged" alt="a judged picture">
        <figcaption>Outlined in red: what the detector takes for the region, in the first picture that shows some of it, or else in the first one</figcaption>
      </figure>
      <ol class="flight-log" aria-label="log" tabindex="0">
        <li v-for="[number, t, level, text] in lines" :key="number" :class="level">
          <time>{{ clock(t) }}</time> {{ text }}
        </li>
      </ol>
    </div>
  </div>`,
  data() {
    return { scene: null, figures: [], rows: [], lines: [], banner: "", caption: "", pictured: false, judged: "" };
  },
  mounted() {
    this.map = new FlightMap(this.$refs.map);
    window.flightMap = this.map; // for tests, and whoever looks into it
    this.map.onresults = (asked) => {
      const image = new Image();
      image.onload = () => (this.judged = image.src);
      image.src = "result/judged.jpg?" + asked;
    };
    this.heard_ms = performance.now();
    this.timer = setInterval(() => this.check(), 1000);
  },
  unmounted() {
    clearInterval(this.timer);
    this.map.over = true;
  },
  methods: {
    clock,
    fit() {
      this.map.touched = false;
      this.map.fit();
    },
    setting(scene) {
      this.scene = scene;
      this.map.setting(scene);
    },
    // a delta, and how the flight is followed; the answer is the version that is shown, 0 where a
    // snapshot is needed
    take(delta, link) {
      this.heard_ms = performance.now();
      this.link = link;
      document.body.classList.toggle("flight-ended", !!link.text);
      this.check();
      if (!this.scene || !this.map.take(delta)) return 0;
      const board = this.map.board;
      if (Object.keys(delta.vehicles).length) this.listVehicles(board);
      if (Object.keys(delta.fields).length) this.listFigures(board.fields);
      if ("picture" in delta.fields || delta.since === 0) this.showPicture(board.fields.picture);
      if (delta.log.length || delta.since === 0) this.lines = board.log.slice().reverse();
      this.check();
      return board.version;
    },
    check() {
      if (!this.link) return;
      const silent_s = Math.round((performance.now() - this.heard_ms) / 1000);
      const over = this.map.board.fields.over;
      if (this.link.text) this.banner = this.link.text;
      else if (this.link.live && !over && silent_s >= SILENT_S)
        this.banner = "nothing new for " + silent_s + " s: what is shown is that old";
      else this.banner = "";
    },
    listVehicles(board) {
      this.rows = Object.entries(board.vehicles).map(([number, v]) => ({
        ...v,
        number,
        colour: this.map.colour(number),
        up: Math.round(v.up) || 0, // never -0
        left: v.landed ? "" : clock(v.left_s),
      }));
    },
    listFigures(f) {
      const rows = [["mission time", clock(f.t_s)], ["phase", f.phase]];
      if (f.known) rows.push(["map", f.known]);
      rows.push(["region", f.roi + " cells decided"]);
      this.scene.classes.forEach((name, i) => {
        const area_m2 = (f.class_areas_m2 || [])[i];
        if (area_m2) rows.push(["of it " + name, Math.round(area_m2) + " m²"]);
      });
      if (f.frames)
        rows.push(["pictures judged", f.frames[0] + (f.frames[1] ? ", " + f.frames[1] + " lost" : "")]);
      const c = f.certificate;
      if (c && c.lower_bound_s) {
        rows.push(["exploration up to " + clock(c.t_s), clock(c.exploration_s)]);
        rows.push(["nobody can be faster than", clock(c.lower_bound_s)]);
        if (c.ratio) rows.push(["ratio of the two", c.ratio.toFixed(2)]);
        if (c.bound_s) rows.push(["the strategy's bound", clock(c.bound_s)]);
      }
      if (f.left && f.left.share !== null)
        rows.push(["done", "about " + Math.floor(100 * f.left.share) + " % of " + f.left.of]);
      if (f.left && f.left.what)
        rows.push(["left, as far as is known", f.left.what + (f.left.about_s === null ? "" : ", about " + clock(f.left.about_s))]);
      if (f.over) rows.push(["found", f.finding]);
      this.figures = rows;
    },
    showPicture(picture) {
      this.pictured = !!picture;
      if (!picture) {
        this.caption = this.link && this.link.pictures ? this.link.pictures : "no picture yet";
        return;
      }
      const image = new Image();
      image.onload = () => {
        if (this.map.board.fields.picture !== picture) return; // a newer one is under way
        const yes = picture.cells.filter((cell) => cell[8]).length;
        this.caption = `vehicle ${picture.vehicle} at ${clock(picture.t_s)}: ${yes} of ${picture.cells.length} cells look like region`;
        const canvas = this.$refs.picture;
        const width = (canvas.width = image.naturalWidth);
        const height = (canvas.height = image.naturalHeight);
        const pen = canvas.getContext("2d");
        pen.drawImage(image, 0, 0);
        for (const only of [0, 1])
          for (const cell of picture.cells) {
            if (cell[8] !== only) continue;
            pen.strokeStyle = only ? "#3cc83c" : "#c8c8c8";
            pen.lineWidth = only ? 2.5 : 1.2;
            pen.beginPath();
            for (let i = 0; i < 8; i += 2) pen.lineTo(cell[i] * width, cell[i + 1] * height);
            pen.closePath();
            pen.stroke();
          }
      };
      image.src = "picture/" + encodeURIComponent(picture.id);
    },
  },
};
