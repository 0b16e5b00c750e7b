--[[
rsdeblur.lua: an export target of darktable that removes camera-shake blur with the gyroscope's log.

darktable renders each photo with all its edits and metadata into a temporary file, `rsdeblur deblur` restores it beside
the raw file (NAME-sharp.EXT), and the result is imported and grouped with the original. Nothing is overwritten.

The log and the camera file come from the fields of the target. Where they are empty, they are files beside the photo:
NAME.gyro.csv (or gyro.csv) and camera.toml. "Exposure" contains the options that give the exposure, as on the command
line: `--capture frames.csv --index 4`, or `--start 12.5 --duration 1/20`. `$(FILE)` becomes the path of the original
without its extension, `$(FOLDER)` its folder.

The picture must keep the size and the place of the sensor's pixels: export at full size, with lens correction, crop,
rotation and perspective switched off.

To install, copy this file to ~/.config/darktable/lua/ and add `require "rsdeblur"` to ~/.config/darktable/luarc.
]]

local dt = require "darktable"

local MODULE = "rsdeblur"
local FIELDS = {
  { key = "program", label = "rsdeblur", default = "rsdeblur", tip = "path of the program" },
  { key = "gyro", label = "gyro log", default = "", tip = "empty: NAME.gyro.csv or gyro.csv beside the photo" },
  { key = "camera", label = "camera file", default = "", tip = "empty: camera.toml beside the photo" },
  { key = "exposure", label = "exposure", default = "--start 0", tip = "like --start 12.5 --duration 1/20" },
  { key = "options", label = "more options", default = "", tip = "like --mode rowwise --prior hyper-laplacian" },
}

local function exists(path)
  local file = io.open(path, "r")
  if file then file:close() end
  return file ~= nil
end

-- A word of the command line that no shell interprets.
local function quoted(text)
  return "'" .. text:gsub("'", "'\\''") .. "'"
end

-- The words of the user's options, each quoted; only quotes and spaces separate them, so that the shell runs nothing.
local function quoted_words(text)
  local words, word, quote = {}, nil, nil
  for c in text:gmatch(".") do
    if quote then
      if c == quote then quote = nil else word = word .. c end
    elseif c == "'" or c == '"' then
      quote, word = c, word or ""
    elseif c:match("%s") then
      if word then words[#words + 1] = quoted(word) end
      word = nil
    else
      word = (word or "") .. c
    end
  end
  if word then words[#words + 1] = quoted(word) end
  return table.concat(words, " ")
end

local function expanded(text, folder, stem)
  local values = { FILE = folder .. "/" .. stem, FOLDER = folder }
  return (text:gsub("%$%((%u+)%)", values))
end

-- A name beside the original that no file has.
local function free_name(folder, stem, extension)
  local path, number = folder .. "/" .. stem .. "-sharp." .. extension, 1
  while exists(path) do
    number = number + 1
    path = string.format("%s/%s-sharp-%d.%s", folder, stem, number, extension)
  end
  return path
end

local function first_that_exists(paths)
  for _, path in ipairs(paths) do
    if exists(path) then return path end
  end
  return nil, paths[1]
end

-- The command for one photo, and its output; nil and the reason where a file is missing.
local function command_for(image, rendered, settings)
  local stem = image.filename:gsub("%.[^.]*$", "")
  local folder = image.path
  local function given(key)
    local text = expanded(settings[key], folder, stem)
    return text ~= "" and text or nil
  end
  local own_gyro = { folder .. "/" .. stem .. ".gyro.csv", folder .. "/gyro.csv" }
  local gyro, no_gyro = first_that_exists(given("gyro") and { given("gyro") } or own_gyro)
  if not gyro then return nil, "no gyro log: " .. no_gyro end
  local camera, no_camera = first_that_exists({ given("camera") or folder .. "/camera.toml" })
  if not camera then return nil, "no camera file: " .. no_camera end
  local output = free_name(folder, stem, rendered:match("%.([^.]+)$"))
  local words = {
    quoted(settings.program), "deblur", quoted(rendered),
    "--gyro", quoted(gyro), "--camera", quoted(camera),
    quoted_words(expanded(settings.exposure, folder, stem)),
    quoted_words(expanded(settings.options, folder, stem)),
    "-o", quoted(output),
  }
  return table.concat(words, " "), output
end

local entries = {}
local function settings_of_fields()
  local settings = {}
  for _, field in ipairs(FIELDS) do
    settings[field.key] = entries[field.key].text
    dt.preferences.write(MODULE, field.key, "string", entries[field.key].text)
  end
  return settings
end

local function deblur(image, rendered, settings)
  local command, output = command_for(image, rendered, settings)
  if not command then
    dt.print(image.filename .. ": " .. output)
    return false
  end
  dt.print_log(MODULE .. ": " .. command)
  -- Unlike os.execute, this leaves darktable's window responsive.
  local code = dt.control.execute(command)
  if code ~= 0 or not exists(output) then
    dt.print(image.filename .. ": rsdeblur failed; start darktable in a terminal to see why")
    return false
  end
  local result = dt.database.import(output)
  result:group_with(image)
  return true
end

local function finalize(_, rendered_images, _)
  local settings, done, total = settings_of_fields(), 0, 0
  for image, rendered in pairs(rendered_images) do
    total = total + 1
    if deblur(image, rendered, settings) then done = done + 1 end
    os.remove(rendered)
  end
  dt.print(string.format("rsdeblur: %d of %d photos restored", done, total))
end

local function widget()
  local rows = { orientation = "vertical" }
  for _, field in ipairs(FIELDS) do
    local stored = dt.preferences.read(MODULE, field.key, "string")
    local entry = dt.new_widget("entry") { text = stored ~= "" and stored or field.default, tooltip = field.tip }
    entries[field.key] = entry
    rows[#rows + 1] = dt.new_widget("label") { label = field.label }
    rows[#rows + 1] = entry
  end
  return dt.new_widget("box")(rows)
end

local function supported(_, format)
  local extension = format.extension
  return extension == "jpg" or extension == "tif" or extension == "png"
end

dt.register_storage(MODULE, "rsdeblur", nil, finalize, supported, nil, widget())

return { command_for = command_for, free_name = free_name, quoted_words = quoted_words }
