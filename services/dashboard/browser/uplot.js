// What the pages use of uPlot.

export { default as uPlot } from "uplot";
