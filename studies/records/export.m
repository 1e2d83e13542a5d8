% Runs editors/matlab/fdm_export.m in Octave and reads what it wrote to the bit.
%   octave --no-gui studies/records/export.m
% Octave has no iddata, table and timetable: classes in studies/records/octave stand in for them, with the properties that MathWorks
% documents. What MATLAB's own classes do beyond that is not tested.
home = fileparts(mfilename('fullpath'));
addpath(fullfile(home, 'octave'), fullfile(home, '..', '..', 'editors', 'matlab'));
file = [tempname(), '.csv'];
t = (0:99)' / 7;
p = sin(t);
xyz = [cos(t), t.^3, -t];
p(5) = NaN;

function is(file, header, values)
  text = fileread(file);
  end_of_titles = find(text == "\n", 1);
  first = text(1:end_of_titles - 1);
  assert(strcmp(first, header), '%s', first);
  % textscan is off by a bit now and then
  found = sscanf(strrep(text(end_of_titles + 1:end), ',', ' '), '%f');
  found = reshape(found, columns(values), []).';
  assert(isequaln(found, values));
  printf('%s: %d rows to the bit\n', header, rows(values));
end

function same = isequaln(a, b)
  same = isequal(size(a), size(b)) && all((a(:) == b(:)) | (isnan(a(:)) & isnan(b(:))));
end

x = iddata();
x.SamplingInstants = t;
x.InputData = p;
x.OutputData = xyz(:, 1:2);
x.InputName = {'u'};
x.InputUnit = {'deg'};
x.OutputName = {'y1'; 'y,2'};
x.OutputUnit = {'m'; ''};
fdm_export(x, file);
is(file, 't [s],u [deg],y1 [m],"y,2"', [t, p, xyz(:, 1:2)]);
x.TimeUnit = 'hours';
fdm_export(x, file);
is(file, 't [h],u [deg],y1 [m],"y,2"', [t, p, xyz(:, 1:2)]);
x.SamplingInstants = {t, t};
try
  fdm_export(x, file);
  error('several experiments were accepted');
catch e
  assert(strcmp(e.identifier, 'fdm_export:experiments'), e.message);
end

y = timetable();
y.p = p;
y.xyz = xyz;
y.note = repmat({'steady'}, 100, 1);
y.Properties.RowTimes = duration(t);
warning('off', 'fdm_export:column');
fdm_export(y, file);
is(file, 't [s],p [rad/s],xyz_1 [m],xyz_2 [m],xyz_3 [m]', [t, p, xyz]);
fdm_export(timetable2table(y, 'ConvertRowTimes', false), file);
is(file, 'p [rad/s],xyz_1 [m],xyz_2 [m],xyz_3 [m]', [p, xyz]);

fdm_export(struct('t', t, 'p', p'), file);
is(file, 't,p', [t, p]);
for wrong = {struct('t', t, 'p', 1), 3, 'text'}
  try
    fdm_export(wrong{1}, file);
    error('what is no table was accepted');
  catch e
    assert(strncmp(e.identifier, 'fdm_export:', 11), e.message);
  end
end
