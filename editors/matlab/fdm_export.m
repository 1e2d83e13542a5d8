function fdm_export(x, file)
% FDM_EXPORT  Write a timetable, an iddata object or a table as CSV with units in its titles, as fdm reads it.
%   fdm_export(x, 'run.csv')
% MATLAB saves such objects in a form that is not published, so that no other program reads them from a MAT-file.
  if isa(x, 'iddata')
    if iscell(x.SamplingInstants)
      error('fdm_export:experiments', 'write one experiment at a time: fdm_export(getexp(x, 1), ''run_1.csv'')');
    end
    names = [{'t'}; x.InputName(:); x.OutputName(:)];
    units = [{x.TimeUnit}; x.InputUnit(:); x.OutputUnit(:)];
    units(strcmp(units, 'seconds')) = {'s'};
    units(strcmp(units, 'minutes')) = {'min'};
    values = [x.SamplingInstants(:), x.InputData, x.OutputData];
  elseif isa(x, 'timetable')
    t = x.Properties.RowTimes;
    if isa(t, 'datetime')
      t = t - t(1);
    end
    [names, units, values] = columns(timetable2table(x, 'ConvertRowTimes', false));
    names = [{'t'}; names];
    units = [{'s'}; units];
    values = [seconds(t(:)), values];
  elseif isa(x, 'table')
    [names, units, values] = columns(x);
  else
    error('fdm_export:class', 'expected a timetable, an iddata object or a table, found %s', class(x));
  end
  f = fopen(file, 'w');
  if f < 0
    error('fdm_export:file', '%s cannot be written', file);
  end
  titles = cellfun(@(n, u) [n, repmat([' [', u, ']'], 1, ~isempty(u))], names, units, 'UniformOutput', false);
  fprintf(f, '%s\n', strjoin(titles(:)', ','));
  fprintf(f, [repmat('%.17g,', 1, numel(names) - 1), '%.17g\n'], values.');
  fclose(f);
end

function [names, units, values] = columns(x)
% The numbers of a table; a variable of several columns has a number behind its name.
  names = {};
  units = {};
  values = zeros(height(x), 0);
  known = x.Properties.VariableUnits;
  for k = 1:width(x)
    name = x.Properties.VariableNames{k};
    column = x.(name);
    if isduration(column)
      column = seconds(column);
    elseif ~(isnumeric(column) || islogical(column))
      warning('fdm_export:column', '%s holds no numbers and is left out', name);
      continue
    end
    for c = 1:size(column, 2)
      own = name;
      if size(column, 2) > 1
        own = sprintf('%s_%d', name, c);
      end
      names{end + 1, 1} = own; %#ok<AGROW>
      units{end + 1, 1} = ''; %#ok<AGROW>
      if ~isempty(known)
        units{end, 1} = known{k};
      end
      values(:, end + 1) = double(column(:, c)); %#ok<AGROW>
    end
  end
end
