classdef duration
% Stands in for MATLAB's duration.
  properties
    value
  end
  methods
    function self = duration(value)
      self.value = value;
    end
    function v = seconds(self)
      v = self.value;
    end
    function v = subsref(self, how)
      if strcmp(how(1).type, '()')
        v = duration(self.value(how(1).subs{:}));
      else
        v = self.value;
      end
    end
  end
end
