-- Neovim 0.7 or newer: models are checked, explained, renamed and laid out by `fdm lsp`.
-- Put this file where your configuration can `require` it, and `require("fdm").setup()`.
local M = {}

function M.setup(options)
  local command = (options and options.command) or { "fdm", "lsp" }
  vim.cmd([[autocmd BufRead,BufNewFile *.fdm setfiletype fdm]])
  vim.api.nvim_create_autocmd("FileType", {
    pattern = "fdm",
    callback = function(event)
      vim.bo[event.buf].commentstring = "// %s"
      vim.bo[event.buf].omnifunc = "v:lua.vim.lsp.omnifunc"
      if not M.client or vim.lsp.client_is_stopped(M.client) then
        M.client = vim.lsp.start_client({ name = "fdm", cmd = command, root_dir = vim.fn.getcwd() })
      end
      vim.lsp.buf_attach_client(event.buf, M.client)
    end,
  })
end

return M
