-- A session of Neovim with `fdm lsp`, written down. From the root of the repository, with `fdm` built:
--   FDM=target/debug/fdm nvim --headless -u NONE -c 'luafile editors/neovim/session.lua'
-- What it prints is kept in docs/reference/editors.md.
vim.opt.runtimepath:append("editors/neovim")
vim.cmd("filetype on")
dofile("editors/neovim/fdm.lua").setup({ command = { vim.env.FDM or "fdm", "lsp" } })

local folder = vim.fn.tempname()
vim.fn.mkdir(folder)
local file = folder .. "/pitch.fdm"

local function say(text) io.stdout:write(text .. "\n") end
local function show(title)
  say("\n--- " .. title)
  for _, line in ipairs(vim.api.nvim_buf_get_lines(0, 0, -1, false)) do say("| " .. line) end
end
local function ask(method, extra)
  local params = vim.tbl_extend("force", vim.lsp.util.make_position_params(), extra or {})
  local answers, error = vim.lsp.buf_request_sync(0, method, params, 10000)
  if error then say("error: " .. error) return end
  for _, answer in pairs(answers) do
    if answer.error then return nil, answer.error.message end
    return answer.result
  end
end
local published = 0
local before = vim.lsp.handlers["textDocument/publishDiagnostics"]
vim.lsp.handlers["textDocument/publishDiagnostics"] = function(...) published = published + 1; return before(...) end
local function findings(title)
  local seen = published
  vim.wait(10000, function() return published > seen end, 10)
  say("\n--- " .. title)
  local found = vim.diagnostic.get(0)
  if #found == 0 then say("no findings") end
  for _, d in ipairs(found) do
    local kind = d.severity == vim.diagnostic.severity.ERROR and "error" or "warning"
    say(string.format("%d:%d %s %s: %s", d.lnum + 1, d.col + 1, kind, d.user_data and d.user_data.lsp.code or d.code or "", (d.message:gsub("\n", "; "))))
  end
end
local function at(line, column) vim.api.nvim_win_set_cursor(0, { line, column }) end

vim.fn.writefile({
  'model pitch "pitch rate, with a slip in it" {',
  '  input stick [deg];',
  '  state q "pitch rate" [deg/s];',
  '  param a = 0.8 [1/s];',
  '  param K=1.5 in[0,10] [1/s^2] "effectiveness"; // found by hand',
  '  der(q) = -a*q + K*stik;',
  '  output q_m [deg/s] = q;',
  '}',
}, file)
vim.cmd("edit " .. file)
show("a file is opened")
findings("what the server finds")

at(6, 20)
local range = vim.lsp.util.make_given_range_params({ 6, 18 }, { 6, 22 })
local fixes = ask("textDocument/codeAction", { range = range.range, context = { diagnostics = {} } })
say("\n--- quick fix: " .. fixes[1].title)
vim.lsp.util.apply_workspace_edit(fixes[1].edit, "utf-16")
findings("after it")

at(6, 6)
say("\n--- hover over `q` in line 6\n" .. ask("textDocument/hover").contents.value)

local place = ask("textDocument/definition")
say(string.format("\n--- definition of `q`: line %d", place.range.start.line + 1))

at(4, 8)
local _, why = ask("textDocument/rename", { newName = "q" })
say("\n--- rename `a` to `q`: " .. why)
_, why = ask("textDocument/rename", { newName = "delay" })
say("--- rename `a` to `delay`: " .. why)
local edit = ask("textDocument/rename", { newName = "damping" })
vim.lsp.util.apply_workspace_edit(edit, "utf-16")
show("rename `a` to `damping`")
findings("after it")

vim.api.nvim_buf_set_lines(0, 5, 5, false, { "  param tau = 0.1 [" })
at(6, 18)
local units = {}
for _, item in ipairs(ask("textDocument/completion", { position = { line = 5, character = 19 } })) do
  if #units < 12 then table.insert(units, item.label) end
end
say("\n--- completion behind `param tau = 0.1 [`: " .. table.concat(units, " ") .. " ...")
findings("meanwhile")
local rest = vim.api.nvim_buf_get_lines(0, 6, 7, false)
vim.api.nvim_buf_set_lines(0, 5, 8, false, { "  param tau = 0.1 [s];", rest[1], "  output q_m [deg/s] = delay(q, tau);" })
findings("a delay is added")

local edits = ask("textDocument/formatting", { options = { tabSize = 2, insertSpaces = true } })
vim.lsp.util.apply_text_edits(edits, 0, "utf-16")
show("laid out")
say("")
vim.cmd("qall!")
