classdef table
% Stands in for MATLAB's table: three variables, and what fdm_export reads of the rest, as MathWorks documents it.
  properties
    p
    xyz
    note
    Properties = struct('VariableNames', {{'p', 'xyz', 'note'}}, 'VariableUnits', {{'rad/s', 'm', ''}}, 'RowTimes', [])
  end
  methods
    function n = height(self)
      n = size(self.p, 1);
    end
    function n = width(self)
      n = 3;
    end
  end
end
