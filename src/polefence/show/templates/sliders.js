"use strict";
const data = JSON.parse(document.getElementById("family").textContent);
const bar = document.getElementById("sliders");
const paths = [...document.querySelectorAll("svg.chosen path")];
const inputs = data.sliders.map(({ name, texts }) => {
  const label = document.createElement("label");
  const input = document.createElement("input");
  const value = document.createElement("output");
  Object.assign(input, { type: "range", min: 0, max: texts.length - 1 });
  input.value = (texts.length - 1) / 2;
  label.append(`${name} `, input, value);
  bar.append(label);
  return { input, value, texts };
});
const show = () => {
  let chosen = 0;
  for (const { input, value, texts } of inputs) {
    chosen = chosen * texts.length + Number(input.value);
    value.textContent = texts[input.value];
  }
  paths.forEach((path, k) => path.setAttribute("d", data.panels[k][chosen]));
};
bar.addEventListener("input", show);
bar.hidden = false;
show();
