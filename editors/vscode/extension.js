// Starts `fdm lsp` when a model is opened.
const { workspace } = require('vscode');
const { LanguageClient } = require('vscode-languageclient/node');

let client;

exports.activate = async () => {
  const command = workspace.getConfiguration('fdm').get('command', 'fdm');
  const server = { command, args: ['lsp'] };
  client = new LanguageClient('fdm', 'fdm', server, { documentSelector: [{ language: 'fdm' }] });
  await client.start();
};

exports.deactivate = () => client?.stop();
