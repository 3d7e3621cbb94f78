// Builds the page from the data in it. Text from the data is only ever set as text.
'use strict';
(() => {
  const data = JSON.parse(document.getElementById('data').textContent);
  const summary = data.summary;
  const page = document.getElementById('page');
  const colors = {
    blue: '#0072b2', orange: '#e69f00', red: '#d55e00', green: '#009e73', pink: '#cc79a7', sky: '#56b4e9', grey: '#8a939c'
  };

  const element = (tag, className, text) => {
    const e = document.createElement(tag);
    if (className) e.className = className;
    if (text !== undefined) e.textContent = text;
    return e;
  };
  const add = (parent, ...children) => { children.forEach(c => parent.appendChild(c)); return parent; };
  const number = (v, digits = 3) => (v === null || v === undefined) ? '–' : Number(v).toLocaleString('en', {maximumFractionDigits: digits});
  const fixed = (v, digits) => (v === null || v === undefined) ? '–' :
    Number(v).toLocaleString('en', {minimumFractionDigits: digits, maximumFractionDigits: digits});  // columns line up
  const section = (title, hint) => {
    const s = add(element('section'), element('h2', '', title));
    if (hint) add(s, element('p', 'hint', hint));
    return add(page, s), s;
  };
  const card = (parent, title) => {
    const c = element('div', 'card');
    if (title) add(c, element('h3', '', title));
    return add(parent, c), c;
  };
  const table = (parent, head, rows, numeric = []) => {  // a table that is wider than the page scrolls by itself
    const kind = i => numeric.includes(i) ? 'number' : '';
    const t = element('table');
    if (head) add(t, add(element('thead'), add(element('tr'), ...head.map((h, i) => element('th', kind(i), h)))));
    const cell = (v, i) => v instanceof Node ? add(element('td', kind(i)), v) : element('td', kind(i), v);
    add(t, add(element('tbody'), ...rows.map(r => add(element('tr'), ...r.map(cell)))));
    return add(parent, add(element('div', 'table'), t)), t;
  };

  // --- charts: hover by Chart.js, zoom and pan by what follows -------------------------------------------------------
  const charts = [];
  const over = {  // stretches that are not tracking, behind the curves over time
    id: 'states',
    beforeDatasetsDraw(chart) {
      if (!chart.options.showStates) return;
      const {ctx, chartArea: area, scales: {x}} = chart;
      ctx.save();
      for (const [from, to, state] of data.states) {
        const a = Math.max(area.left, x.getPixelForValue(from)), b = Math.min(area.right, x.getPixelForValue(to));
        if (b < area.left || a > area.right) continue;
        ctx.fillStyle = state === 'lost' ? 'rgba(193,39,45,0.22)' : 'rgba(230,159,0,0.22)';
        ctx.fillRect(a, area.top, Math.max(b - a, 1.5), area.bottom - area.top);
      }
      ctx.restore();
    }
  };
  const setRange = (chart, axis, low, high) => {
    chart.options.scales[axis].min = low;
    chart.options.scales[axis].max = high;
  };
  const apply = chart => {
    chart.update('none');
    if (!chart.options.group) return;
    for (const other of charts) {  // charts over the same axis move together
      if (other === chart || other.options.group !== chart.options.group) continue;
      setRange(other, 'x', chart.options.scales.x.min, chart.options.scales.x.max);
      other.update('none');
    }
  };
  const zoomable = (chart, axes) => {
    const canvas = chart.canvas;
    const each = f => axes.forEach(axis => f(axis, chart.scales[axis]));
    const inside = e => {
      const a = chart.chartArea;
      return e.offsetX >= a.left && e.offsetX <= a.right && e.offsetY >= a.top && e.offsetY <= a.bottom;
    };
    canvas.addEventListener('wheel', e => {
      if (!inside(e)) return;
      e.preventDefault();
      const factor = Math.pow(1.0015, e.deltaY);
      each((axis, s) => {
        const at = s.getValueForPixel(axis === 'x' ? e.offsetX : e.offsetY);
        setRange(chart, axis, at + (s.min - at) * factor, at + (s.max - at) * factor);
      });
      apply(chart);
    }, {passive: false});
    let last = null;
    canvas.addEventListener('pointerdown', e => {
      if (!inside(e)) return;
      last = e;
      canvas.setPointerCapture(e.pointerId);
    });
    canvas.addEventListener('pointermove', e => {
      if (!last) return;
      each((axis, s) => {
        const from = s.getValueForPixel(axis === 'x' ? last.offsetX : last.offsetY);
        const to = s.getValueForPixel(axis === 'x' ? e.offsetX : e.offsetY);
        setRange(chart, axis, s.min + from - to, s.max + from - to);
      });
      last = e;
      apply(chart);
    });
    ['pointerup', 'pointercancel'].forEach(name => canvas.addEventListener(name, () => { last = null; }));
    canvas.addEventListener('dblclick', () => {
      axes.forEach(axis => setRange(chart, axis, chart.home[axis][0], chart.home[axis][1]));
      apply(chart);
    });
  };
  // [null, null] is a break in the line.
  const points = list => list.map(([x, y]) => x === null || y === null ? {x: NaN, y: NaN} : {x, y});
  const line = (label, list, color, extra = {}) => Object.assign({
    label, data: points(list), borderColor: color, backgroundColor: color, borderWidth: 1.6, pointRadius: 0, pointHitRadius: 6,
    pointStyle: 'line', showLine: true, tension: 0, spanGaps: false
  }, extra);
  const chart = (parent, className, datasets, options) => {
    if (typeof Chart === 'undefined') {
      add(parent, element('p', 'hint', 'No charts: install libjs-chart.js and build again. The pictures and tables are complete.'));
      return null;
    }
    const box = element('div', 'chart ' + className), canvas = element('canvas');
    add(parent, add(box, canvas));
    const axis = (title, more) => Object.assign({
      type: 'linear', title: {display: true, text: title, color: '#667380'}, grid: {color: '#e9edf1'},
      ticks: {color: '#667380', maxRotation: 0, includeBounds: false, callback: v => Number(Number(v).toPrecision(6)).toLocaleString('en', {maximumSignificantDigits: 6})}
    }, more);
    const c = new Chart(canvas, {
      type: 'scatter', data: {datasets}, plugins: [over],
      options: {
        // Over time x rises from point to point; Chart.js would look for the visible part of a path likewise, and lose it.
        animation: false, maintainAspectRatio: false, parsing: options.path ? undefined : false, normalized: !options.path, group: options.group,
        showStates: options.showStates, interaction: {mode: options.mode || 'nearest', axis: options.mode ? 'x' : 'xy', intersect: false},
        scales: {x: axis(options.x, options.xAxis), y: axis(options.y, options.yAxis)},
        plugins: {
          legend: {labels: {usePointStyle: true, boxHeight: 6, color: '#1f2933', sort: (a, b) => a.datasetIndex - b.datasetIndex}},
          tooltip: {callbacks: {label: i => `${i.dataset.label}: ${options.mode ? '' : number(i.parsed.x, 2) + ', '}${number(i.raw.own === undefined ? i.parsed.y : i.raw.own, 4)}`,
            title: items => options.mode && items.length ? `${options.x}: ${number(items[0].parsed.x, 2)}` : ''}}
        }
      }
    });
    c.home = {x: [c.options.scales.x.min, c.options.scales.x.max], y: [c.options.scales.y.min, c.options.scales.y.max]};
    charts.push(c);
    zoomable(c, options.zoom || ['x']);
    return c;
  };
  // Few values far above all others would flatten the curve: the axis ends above the others until it is asked for all.
  const usualTop = datasets => {
    const values = datasets.flatMap(d => d.data).map(p => p.y).filter(Number.isFinite).sort((a, b) => a - b);
    if (values.length < 20) return null;
    const most = values[values.length - 1], usual = 1.4 * values[Math.floor(0.98 * (values.length - 1))];
    return usual > 0 && most > 2.5 * usual ? {usual, most} : null;
  };
  const overTime = (parent, title, datasets, y, yAxis = {}, className = '') => {
    const lists = datasets.flatMap(d => d.data), xs = lists.map(p => p.x).filter(Number.isFinite);
    const range = xs.length ? {min: xs.reduce((a, b) => Math.min(a, b)), max: xs.reduce((a, b) => Math.max(a, b))} : {};
    const top = yAxis.beginAtZero ? usualTop(datasets) : null;
    const c = card(parent, title);
    const drawn = chart(c, className, datasets, {x: data.time_label, y, yAxis: top ? {...yAxis, max: top.usual} : yAxis, xAxis: range,
      group: 'time', showStates: true, mode: 'nearest'});
    if (!top || !drawn) return;
    const beyond = datasets.flatMap(d => d.data).filter(p => p.y > top.usual).length;
    const button = element('button', 'all');
    let all = false;
    const show = () => {
      drawn.options.scales.y.max = all ? undefined : top.usual;
      drawn.update('none');
      button.textContent = all ? 'Cut the peaks off' : `${number(beyond, 0)} ${beyond === 1 ? 'value lies' : 'values lie'} above the axis, up to ${number(top.most, 1)} ${(y.match(/\[(.*)\]/) || ['', y])[1]}: show all`;
    };
    button.addEventListener('click', () => { all = !all; show(); });
    show();
    add(c, button);
  };

  // --- the page ------------------------------------------------------------------------------------------------------
  document.title = 'HP2-SLAM: ' + (data.meta.data || 'session');
  const head = element('header');
  add(head, element('h1', '', data.meta.data || 'HP2-SLAM session'));
  const line2 = [data.meta.sensor, data.meta.format, data.meta.started, 'session ' + summary.session_id].filter(Boolean).join(' · ');
  add(page, add(head, element('p', '', line2)));

  const tiles = element('div', 'tiles');
  const tile = (value, label, bad) => {
    const t = add(element('div', 'tile' + (bad ? ' bad' : '')), element('b', '', value), element('span', '', label));
    add(tiles, t);
  };
  const total = summary.milliseconds.total;
  tile(number(summary.poses_out, 0), `poses for ${number(summary.scans_in, 0)} scans`);
  tile(number(summary.path_m, 0) + ' m', 'driven');
  if (summary.accuracy) {
    tile(number(summary.accuracy.final.ate.rmse) + ' m', 'ATE, final');
    tile(number(summary.accuracy.odometry.ate.rmse) + ' m', 'ATE, odometry alone');
  }
  tile(number(summary.closures.accepted, 0), `loop closures (${number(summary.closures.rejected, 0)} refused)`);
  tile(number(total.median, 1) + ' ms', `a scan, median (99 %: ${number(total.p99, 1)} ms)`);
  if (summary.scans_per_s !== null) tile(number(summary.scans_per_s, 1), 'scans a second, all processes');
  tile(number(summary.scans_lost, 0), 'scans lost', summary.scans_lost > 0);
  tile(number(summary.scans_skipped, 0), 'scans skipped', summary.scans_skipped > 0);
  add(page, tiles);

  const remarks = section('What to mind');
  if (!data.remarks.length) add(card(remarks), element('p', '', 'Nothing: no scan lost or skipped, tracking throughout.'));
  for (const r of data.remarks) {
    const c = card(remarks);
    c.classList.add('remark', r.level);
    add(c, element('p', '', r.text));
    if (r.advice) add(c, element('p', '', r.advice));
  }

  const where = section('Trajectory', 'Seen from above, map frame. Wheel: zoom. Drag: move. Double click: back. Click a name: hide it.' + (data.gaps ? ` The ${data.gaps === 1 ? 'line breaks' : 'lines break'} where scans are missing.` : ''));
  const datasets = [];
  if (data.paths['ground truth']) datasets.push(line('ground truth', data.paths['ground truth'], '#9aa5b1', {borderWidth: 5, order: 5}));
  datasets.push(line('odometry', data.paths.odometry, colors.orange, {borderDash: [6, 4], order: 4}));
  datasets.push(line('final', data.paths.final, colors.blue, {borderWidth: 2.2, order: 3}));
  const links = data.closures.filter(c => c.accepted && c.line).flatMap(c => [...points(c.line), {x: NaN, y: NaN}]);
  if (links.length) datasets.push(line('accepted closures', [], colors.pink, {data: links, borderWidth: 2, order: 2, spanGaps: false}));
  const ends = data.paths.final.filter(p => p[0] !== null);
  if (ends.length) {
    datasets.push(line('start', [ends[0]], colors.green, {showLine: false, pointStyle: 'circle', pointRadius: 6, order: 1}));
    datasets.push(line('end', [ends[ends.length - 1]], '#c1272d', {showLine: false, pointStyle: 'circle', pointRadius: 6, order: 1}));
  }
  const map = chart(card(where), 'square', datasets, {x: 'x [m]', y: 'y [m]', zoom: ['x', 'y'], path: true});
  if (map) {
    const all = datasets.flatMap(d => d.data).filter(p => Number.isFinite(p.x) && Number.isFinite(p.y));
    const span = k => all.reduce((b, p) => Math.max(b, p[k]), -Infinity) - all.reduce((a, p) => Math.min(a, p[k]), Infinity);
    if (all.length) {  // a straight drive needs no square
      const wanted = map.canvas.clientWidth * span('y') / Math.max(span('x'), 1e-9) + 120;
      map.canvas.parentNode.style.height = Math.round(Math.min(620, Math.max(300, wanted))) + 'px';
      map.resize();
    }
    const fit = () => {  // one metre is as long on both axes
      const area = map.chartArea, w = area.right - area.left, h = area.bottom - area.top;
      const range = k => all.reduce(([a, b], p) => [Math.min(a, p[k]), Math.max(b, p[k])], [Infinity, -Infinity]);
      const [x0, x1] = all.length ? range('x') : [0, 1], [y0, y1] = all.length ? range('y') : [0, 1];
      const unit = Math.max((x1 - x0) * 1.08 / w, (y1 - y0) * 1.08 / h, 1e-3);
      map.home = {x: [(x0 + x1 - unit * w) / 2, (x0 + x1 + unit * w) / 2], y: [(y0 + y1 - unit * h) / 2, (y0 + y1 + unit * h) / 2]};
      ['x', 'y'].forEach(axis => setRange(map, axis, ...map.home[axis]));
      map.update('none');
    };
    fit();
    fit();  // tick labels have changed the chart's area
    let width = window.innerWidth;
    window.addEventListener('resize', () => { if (window.innerWidth !== width) { width = window.innerWidth; setTimeout(fit, 50); } });
  }
  const picture = document.getElementById('map-picture');
  if (picture) add(card(where, 'Map'), picture);

  if (data.accuracy) {
    const s = section('Against ground truth', `Positions after ${data.accuracy.alignment === 'se3' ? 'SE(3) alignment' : 'alignment of the first pose'}; as evo and the KITTI devkit measure.`);
    const row = (name, e) => [name, fixed(e.ate.rmse, 3), fixed(e.ate.mean, 3), fixed(e.ate.median, 3), fixed(e.ate.max, 3),
      fixed(e.rpe_translation.rmse, 4), fixed(e.rpe_rotation_deg.rmse, 4), fixed(e.kitti.t_percent, 3), fixed(e.kitti.r_deg_per_100m, 3)];
    table(card(s), ['', 'ATE RMSE [m]', 'mean', 'median', 'max', 'RPE RMSE [m]', '[°]', 'KITTI drift [%]', '[°/100 m]'],
          [row('final', summary.accuracy.final), row('odometry', summary.accuracy.odometry)], [1, 2, 3, 4, 5, 6, 7, 8]);
    const along = {x: 'path [m]', mode: 'nearest', group: 'path'};
    const last = data.accuracy.ape.length ? data.accuracy.ape[data.accuracy.ape.length - 1][0] : 1;
    along.xAxis = {min: 0, max: last};
    chart(card(s, 'Absolute position error along the path'), '', [
      line('odometry', data.accuracy.ape_odometry, colors.orange, {borderDash: [6, 4], order: 2}),
      line('final', data.accuracy.ape, colors.blue, {order: 1})
    ], {...along, y: 'error [m]', yAxis: {beginAtZero: true}});
    chart(card(s, 'Error of the final trajectory by axis'), '', [
      line('x', data.accuracy.x, colors.red), line('y', data.accuracy.y, colors.green), line('z', data.accuracy.z, colors.blue)
    ], {...along, y: 'error [m]'});
  }

  const front = section('Registration', 'Orange: degenerate, red: lost. Charts over time move together.');
  const grid = add(element('div', 'pair'));
  add(front, grid);
  overTime(grid, 'Planar ratio α = |P| / (|P| + |Q|)', [line('alpha', data.alpha, colors.blue)], 'alpha', {min: 0, max: 1});
  overTime(grid, 'Scale of the robust loss σ', [line('sigma', data.sigma, colors.green)], 'sigma [m]', {beginAtZero: true});
  overTime(grid, 'Degeneracy: smallest over largest eigenvalue', [line('ratio', data.degeneracy.filter(p => p[1] > 0), colors.red)], 'ratio', {
    type: 'logarithmic', ticks: {color: '#667380', callback: v => Number.isInteger(Math.round(Math.log10(v) * 1e6) / 1e6) ? String(v) : null}
  });
  overTime(grid, 'Iterations', [line('iterations', data.iterations, colors.grey)], 'iterations', {beginAtZero: true});
  const states = summary.states;
  add(card(front, 'State'), element('p', '', `tracking ${number(states.tracking, 0)} · degenerate ${number(states.degenerate, 0)} · lost ${number(states.lost, 0)} scans`));

  const time = section('Time a scan');
  const stageColors = [colors.sky, colors.blue, colors.green, colors.orange, colors.pink];
  const names = Object.keys(data.stages);
  if (names.length && data.stages[names[0]].length) {
    const sums = data.stages[names[0]].map(() => 0);
    const stacked = names.map((name, k) => {
      const list = data.stages[name].map(([x, v], i) => [x, sums[i] += v]);
      const dataset = line(name.replace('_', ' '), list, stageColors[k], {fill: k === 0 ? 'origin' : '-1', borderWidth: 0.5, order: 9, pointStyle: 'rect'});
      dataset.data.forEach((p, i) => { p.own = data.stages[name][i][1]; });
      dataset.backgroundColor = stageColors[k] + 'cc';
      return dataset;
    });
    stacked.push(line('total', data.total_ms, '#1f2933', {borderWidth: 0.8, order: 1}));
    overTime(time, 'Milliseconds a scan: stages stacked, and the total', stacked, 'ms', {beginAtZero: true}, 'tall');
  }
  table(card(time), ['stage', 'mean [ms]', 'median', '99 %', 'max'], Object.entries(summary.milliseconds).map(
    ([name, s]) => [name.replace('_', ' '), fixed(s.mean, 2), fixed(s.median, 2), fixed(s.p99, 2), fixed(s.max, 2)]), [1, 2, 3, 4]);

  const byPosition = data.closures.some(r => r.inliers === 0);
  const loops = section('Loop closures', byPosition ? 'Inliers: features that agree between the two images from above. “by position”: the submaps were compared because the trajectory says that they overlap; the images were not needed.' : '');
  if (!data.closures.length) {
    add(card(loops), element('p', '', 'There was no candidate.'));
  } else {
    if (data.closures_total > data.closures.length) add(loops, element('p', 'hint', `The first ${data.closures.length} of ${data.closures_total}; closures.csv has all.`));
    const c = card(loops);
    c.classList.add('scroll');
    table(c, ['from', 'to', 'verdict', 'inliers', 'overlap', 'residual [m]', 'distance [m]', 'angle [°]', 'why not'], data.closures.map(r => [
      String(r.from), String(r.to), element('span', r.accepted ? 'yes' : 'no', r.accepted ? 'accepted' : 'refused'), r.inliers === 0 ? 'by position' : number(r.inliers, 0),
      number(r.overlap, 2), number(r.residual, 3), number(r.distance, 1), number(r.angle, 1), r.reason]), [0, 1, 3, 4, 5, 6, 7]);
  }

  const ran = section('What ran');
  const processes = Object.entries(summary.processes);
  if (processes.length) {
    add(ran, element('p', 'hint', 'As each process spoke last before this page was written; what it did afterwards is in its log.'));
    table(card(ran, 'Processes'), ['process', 'version', 'host', 'last words', 'peak memory [MB]', 'counters'], processes.map(([name, p]) => [
      name, String(p.version || ''), String(p.host || ''), String(p.text || p.state || ''), number(p.peak_memory_mb, 0),
      Object.entries(p.counters || {}).map(([k, v]) => `${k} ${number(v, 0)}`).join(', ')]), [4]);
  }
  table(card(ran, 'Counts'), null, [['scans played', number(summary.scans_in, 0)], ['poses', number(summary.poses_out, 0)],
    ['scans skipped', number(summary.scans_skipped, 0)], ['scans lost', number(summary.scans_lost, 0)], ['submaps', number(summary.submaps, 0)],
    ['map points', number(summary.map_points, 0)], ['drive, by its own clock', number(summary.drive_s, 1) + ' s'], ['from the first pose to the last', number(summary.elapsed_s, 1) + ' s']]);
  const long = v => String(v).includes('\n');
  const short = Object.entries(data.meta).filter(([, v]) => !long(v));
  if (short.length) table(card(ran, 'Session'), null, short.map(([k, v]) => [k, String(v)]));
  for (const [k, v] of Object.entries(data.meta).filter(([, v]) => long(v))) add(card(ran, k), element('pre', '', v));
  document.body.dataset.ready = 'yes';
})();
