export * from './constants.js'
export * from './extension.js'
export * from './decode.js'
export * from './png.js'
